"""Where the organ truly lies: not quite where the plan says, and moved by each breath.

What lies still in the organ is told in its *rest frame*: the world as it was planned, with the organ at rest at exhale.
`T_world_rest` maps it to where the organ truly is. Sensors look from the tip's place in the rest frame.
"""
