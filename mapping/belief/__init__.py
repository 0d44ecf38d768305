"""The belief over the map's weights in its forms, and the algebra that they share.

`belief` says what every form offers: it learns a reading, gives moments and draws, and restores itself from arrays.
`full` keeps the covariance of the weights, either whole (`dense_covariance`) or near its diagonal (`tiled_covariance`);
`diagonal` keeps their variances. What a user holds is `HilbertMap`.
"""
