"""Arms as files: what is read of an MJCF or URDF, what is left out of it, its home and flange, and what is refused."""
