"""The doctor: what is installed, which OpenGL renders here, and what to do about each line that is red."""
