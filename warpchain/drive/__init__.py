"""The drive as data: its parts, read, checked, changed, written."""

from warpchain.drive.arms import Arm
from warpchain.drive.chain import Chain, WornLink
from warpchain.drive.contact_settings import Contact, GuideContact, GuideOverrides, ImpactLaw, Material, SprocketContact
from warpchain.drive.drive import (
    Drive,
    dumps_drive,
    load_drive,
    loads_drive,
    read_drive_text,
    save_drive,
    write_drive_text,
)
from warpchain.drive.face_profile import Piece, Profile
from warpchain.drive.guides import Arc, Guide
from warpchain.drive.motion_table import MotorTable, SpeedTable, TorqueTable
from warpchain.drive.run_settings import RunSettings
from warpchain.drive.shafts import Coupling, Gear, Motor, Shaft
from warpchain.drive.sprocket import (
    ArmMount,
    BalanceWheel,
    Bearing,
    ElasticMount,
    FixedMount,
    Harmonic,
    Load,
    Prescribed,
    PrescribedMount,
    SliderMount,
    Sprocket,
)
from warpchain.drive.tensioners import Chamber, Oil, Plunger, Ratchet, Spring, Tensioner, Valve

__all__ = [
    "Arc",
    "Arm",
    "ArmMount",
    "BalanceWheel",
    "Bearing",
    "Chain",
    "Chamber",
    "Contact",
    "Coupling",
    "Drive",
    "ElasticMount",
    "FixedMount",
    "Gear",
    "Guide",
    "GuideContact",
    "GuideOverrides",
    "Harmonic",
    "ImpactLaw",
    "Load",
    "Material",
    "Motor",
    "MotorTable",
    "Oil",
    "Piece",
    "Plunger",
    "Prescribed",
    "PrescribedMount",
    "Profile",
    "Ratchet",
    "RunSettings",
    "Shaft",
    "SliderMount",
    "SpeedTable",
    "Spring",
    "Sprocket",
    "SprocketContact",
    "Tensioner",
    "TorqueTable",
    "Valve",
    "WornLink",
    "dumps_drive",
    "load_drive",
    "loads_drive",
    "read_drive_text",
    "save_drive",
    "write_drive_text",
]
