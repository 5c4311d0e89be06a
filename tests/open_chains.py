"""Open chains of tests."""

from warpchain import Drive

CONTACT = {
    "profile": "iso606", "gap": "minimum", "restitution": 0.3, "restitution_means": "rebound",
    "impact_speed_floor": 0.02, "stiffness": 5e7,
}  # fmt: skip


def hoist(links=40, start=None, weight=60.0, below=0.4, **run):
    """A 16B chain from a fixed end, `below` [m] a free wheel of 21 teeth, over it and down to a weight that swings.

    The fixed end's side hangs straight down from the wheel.
    """
    pitch, radius = 0.0254, 0.08521
    drop = (links - 10.5) * pitch - below
    return Drive(
        chain={"size": "16B", "links": links, "stiffness": 2e7, "damping_ratio": 0.05, "ends": ["start", "weight"]},
        sprockets=[
            {"name": "start", "center": [-radius, -below]} | (start or {}),
            {"name": "wheel", "teeth": 21, "center": [0.0, 0.0], "wrap": "cw", "inertia": 0.02},
            {"name": "weight", "center": [radius, -drop], "mass": weight, "mount": {"kind": "free"}},
        ],
        contact={"sprocket": CONTACT},
        run={"duration": 0.2, "gravity": [0.0, -9.81], "step": 1e-5, "sample_rate": 2000.0} | run,
    )
