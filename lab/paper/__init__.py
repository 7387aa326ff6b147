"""The paper's experiments, repeated on simulated sets as large as its own."""
