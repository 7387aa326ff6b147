"""This package trains every method on the same clips and compares their accuracy."""
