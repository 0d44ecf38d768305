"""Datasets for those who train on them: many episodes with what was sensed, believed and true, in shards.

`record` is an episode as arrays, which the modules named by a format write. `building` runs the episodes, shard by
shard, and goes on where it was stopped.
"""
