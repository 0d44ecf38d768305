"""What `sounding serve` runs: a session of a configuration, and a simulated probe for trying the other side."""
