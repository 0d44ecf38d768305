"""Ultrasound: B-mode images of a convex array at the probe's tip, and the sensor that sweeps it.

`tissues` says how tissues sound and `label_grid` where they are. `convex_array` and `beam` are the probe. `imager`
draws a plane with the compiled loops of `tracing`, `scattering` and `display`.
"""
