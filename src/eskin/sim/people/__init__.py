"""People: their bodies, their hands, and what they do with them."""
