"""One function per method, each reading as the algorithm of its paper."""
