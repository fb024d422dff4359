"""The job service: REST API, queue, workers, command line."""
