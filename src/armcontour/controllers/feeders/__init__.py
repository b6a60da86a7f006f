"""Feeders: separate processes that need only the client library of a controller."""
