"""Engines: where the trials of a campaign run, in processes of this machine, on Dask or on Ray."""
