"""Commands that convert public sets."""
