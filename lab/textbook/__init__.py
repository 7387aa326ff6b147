"""Test recognition of touches from plain formulas on an ideal sensor."""
