"""Motion of the arm: paths free of collisions, their timing, servos, and contact with a compliant organ."""
