"""Who does the shards of a job: this process, processes of this machine, Dask, Ray."""
