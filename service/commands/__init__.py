"""The commands of `strandline`, by what they need: an engine, a service, a client, checks, or nothing."""
