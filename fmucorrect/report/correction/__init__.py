"""The page of a corrected run beside its measurement."""
