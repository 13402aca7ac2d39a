"""Self-contained HTML pages: `html` builds them, `figures` draws, `comparison_page` puts one together."""
