"""Where arm and organ stand: their options, and what these become."""
