"""The cases of `figures.py`."""
