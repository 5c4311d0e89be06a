"""Drives with silent chains."""

from drives import two_sprockets

from warpchain import Drive


def silent_drive(**values):
    """Two equal wheels of a silent chain; `values` as of `drives.two_sprockets`."""
    whole = two_sprockets(**{"teeth": 20, "links": 60} | values).model_dump(exclude_none=True)
    del whole["chain"]["roller_radius"]
    whole["chain"]["kind"] = "silent"
    return Drive(**whole)
