"""Compiled kernels: numba behind one decorator, its cache, and records that kernels work on."""
