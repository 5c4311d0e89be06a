"""The drive as data: chain, sprockets, guide-bars, contacts, run settings; read, checked, changed and written."""

from warpchain.drive.contact import Contact, GuideContact, GuideOverrides, ImpactLaw, Material, SprocketContact
from warpchain.drive.drive import (
    Drive,
    dumps_drive,
    load_drive,
    loads_drive,
    read_drive_text,
    save_drive,
    write_drive_text,
)
from warpchain.drive.motion import (
    BalanceWheel,
    ElasticMount,
    FixedMount,
    Harmonic,
    Load,
    Prescribed,
    PrescribedMount,
    SliderMount,
)
from warpchain.drive.parts import Chain, Guide, RunSettings, Sprocket, WornLink
from warpchain.drive.table import SpeedTable, TorqueTable

__all__ = [
    "BalanceWheel",
    "Chain",
    "Contact",
    "Drive",
    "ElasticMount",
    "FixedMount",
    "Guide",
    "GuideContact",
    "GuideOverrides",
    "Harmonic",
    "ImpactLaw",
    "Load",
    "Material",
    "Prescribed",
    "PrescribedMount",
    "RunSettings",
    "SliderMount",
    "SpeedTable",
    "Sprocket",
    "SprocketContact",
    "TorqueTable",
    "WornLink",
    "dumps_drive",
    "load_drive",
    "loads_drive",
    "read_drive_text",
    "save_drive",
    "write_drive_text",
]
