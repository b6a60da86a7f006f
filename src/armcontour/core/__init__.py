"""Foundations: checks, errors, results and their presentation, kernels, processes."""
