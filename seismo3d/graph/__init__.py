"""The registration graph: relative measurements as edges, solved robustly and at once."""
