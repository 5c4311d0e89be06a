"""The cases of `docs.py`."""
