"""The belief: a sequential Bayesian Hilbert map, and the metrics of a map."""
