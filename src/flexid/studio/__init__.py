"""The studio: a page on the loopback in which logs are identified."""
