"""Study files as data: their tables, rules and expressions."""

from warpchain.study.spec.study_file import (
    Study,
    check_base_drive,
    dumps_study,
    load_study,
    loads_study,
    study_schema,
)

__all__ = [
    "Study",
    "check_base_drive",
    "dumps_study",
    "load_study",
    "loads_study",
    "study_schema",
]
