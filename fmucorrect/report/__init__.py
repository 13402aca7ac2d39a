"""Self-contained HTML pages, a package a job; `base` holds what they are made of. Words about numbers stand here."""
