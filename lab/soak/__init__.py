"""Test long runs and abrupt ends."""
