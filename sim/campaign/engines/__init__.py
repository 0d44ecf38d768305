"""Engines: where the trials of a campaign run, which is in processes of this machine, on Dask or on Ray."""
