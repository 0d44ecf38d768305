"""The belief over the map's weights, in its forms: full, tiled and diagonal covariances, and the algebra they share.

A form learns a reading, gives moments and draws, and restores itself from arrays. What a user holds is `HilbertMap`."""
