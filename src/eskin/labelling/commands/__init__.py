"""Commands that label recordings."""
