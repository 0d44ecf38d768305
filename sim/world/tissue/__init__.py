"""An organ that yields under a probe: linear elasticity of the whole organ, and of what is close to the probe's face.

`build_elastic_organ` makes a coarse model of the organ once, its `press` answers with an `Indentation`: how far the
probe enters at a force or what force holds it at a depth, where each point of the tissue goes, and where a point of the
deformed tissue came from. docs/tissue.md has the formulas, their sources and their limits.
"""
