"""Harness, drives and clocks that the scripts share."""
