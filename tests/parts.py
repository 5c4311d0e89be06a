"""TOML text of shafts, gears, couplings and other named tables, for drives and studies of tests."""

from warpchain.drive.toml import toml_text


def part(kind, name, **values):
    """A named element of a list of tables, such as "valves"."""
    return toml_text({kind: [{"name": name} | values]})


def shaft(name, **values):
    return part("shafts", name, **values)


def gears(name, between, teeth, **values):
    """A pair of gears of module 4 mm."""
    return part("gears", name, between=between, teeth=teeth, **({"module": 0.004} | values))


def coupling(name, between, stiffness, **values):
    return part("couplings", name, between=between, stiffness=stiffness, **values)
