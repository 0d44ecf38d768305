"""The loop without our world: planner and map for a probe that somebody else carries and a sensor that is not ours.

`session` is the protocol, `propose` and `observe`, and knows no transport; `session_folder` keeps it on disk. `service`
runs one in the background for whatever asks, and `readings` makes readings of what the outside sensed. The transports
lie in rooms below.
"""
