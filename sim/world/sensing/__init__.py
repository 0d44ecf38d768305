"""Sensing: what turns a contact of the probe into a reading.

A `Sensor` looks at a `SceneState` and returns a `Reading`. `ConeSensor` is the paper's: it samples the cone with
`cone_pattern` and labels the samples without error by the crossings of `SurfaceRays`.
"""
