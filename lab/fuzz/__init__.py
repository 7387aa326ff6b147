"""Fuzz everything that reads data of others."""
