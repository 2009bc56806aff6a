"""Many cases on all cores or on a Dask cluster: workers, results that can be resumed, the bar."""
