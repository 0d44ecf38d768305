"""USD: a run with its motion as a stage, which Blender, Omniverse and other renderers open."""
