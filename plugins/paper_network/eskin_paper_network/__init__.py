"""This package holds the paper's network, and recognises with it live."""
