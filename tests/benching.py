"""A benchmark's rows that end in different ways; workers' processes import them."""

import os
import time


def measured(how):
    """What is asked for by name."""
    if how == "fails":
        raise ValueError("no memory\nmore")
    if how == "dies":
        os._exit(3)
    if how == "hangs":
        time.sleep(600.0)
    return (1.5,)
