"""Pictures of a scene: what they have to hold, where the camera stands for that, and the drawing offscreen."""
