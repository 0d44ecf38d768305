"""Pictures and figures: captioned frames of the scene, curves, and the map from above and from the side."""
