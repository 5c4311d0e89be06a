"""TOML text of shafts, gears and couplings, for drives of tests."""

from warpchain.drive.toml import dumps


def part(kind, name, **values):
    """A further part of a kind, such as "valves"."""
    return dumps({kind: [{"name": name} | values]})


def shaft(name, **values):
    return part("shafts", name, **values)


def gears(name, between, teeth, **values):
    """A pair of gears of module 4 mm."""
    return part("gears", name, between=between, teeth=teeth, **({"module": 0.004} | values))


def coupling(name, between, stiffness, **values):
    return part("couplings", name, between=between, stiffness=stiffness, **values)
