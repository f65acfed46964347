"""Benchmarks of a checkout: published problems and other codes, run by ``ruptfx bench NAME`` and by ``bench all``.

The contract, and the core set that checks an installation, are in `ruptfx.app.bench`.
"""
