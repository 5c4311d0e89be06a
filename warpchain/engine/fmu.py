"""`export_fmu`: a drive as an FMU, which other programs co-simulate without Python and Warp.

It has the CPU kernel's code and first launch's memory, linked with `fmu_shell.c` by the system's compiler.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shlex
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Literal

from warpchain.argument_checks import PositiveNumber, check_arguments
from warpchain.drive import Drive, dumps_drive
from warpchain.errors import SimulationError
from warpchain.files import refusals_as_errors, whole_file
from warpchain.version import installed_version

if TYPE_CHECKING:
    from warpchain.engine.stepping import SteppedRun

PLATFORM = "x86_64-linux"
SHELL = Path(__file__).with_name("fmu_shell.c")
COMPILERS = ("cc", "gcc", "clang")
"""C compilers that are tried without CC."""
EXPORTED = "{ global: fmi3*; local: *; };\n"
"""Linker's script of an FMU's visible names."""


@check_arguments(SimulationError)
def export_fmu(
    drive: Drive,
    output: str | Path,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    step: PositiveNumber | Literal["auto"] | None = None,
) -> Path:
    """Exports a drive as an FMU (FMI 3.0, co-simulation, x86-64 Linux); returns its path.

    It has the bits of `simulate` on a CPU, and needs a C compiler here, but nothing where used.

    Args:
        output: the file, which ends in .fmu.
        inputs: as of `stepping`; None: torques of all loads, such as "driven.load_torque".
        outputs: as of `stepping`; None: all channels but those of rollers and links.
        step: as of `simulate`.

    Raises:
        DriveError: a chain that does not fit, or a step beyond its limit.
        SimulationError: an unknown input or output, another kind of computer, no compiler, or an unwritable file.
    """
    path = Path(output)
    if path.suffix.lower() != ".fmu":
        raise SimulationError(f"{path}: ending {path.suffix!r}: must be .fmu")
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        raise SimulationError(
            f"{path}: FMUs are made on x86-64 Linux; here is {platform.machine()} {platform.system()}"
        )
    compiler = compiler_command()
    from warpchain.engine.stepping import stepping
    from warpchain.results.channels import BODY_CHANNELS, channels_of_drive

    if inputs is None:
        loaded = [each.name for parts in (drive.sprockets, drive.shafts) for each in parts if each.load is not None]
        inputs = [f"{name}.load_torque" for name in loaded]
    if outputs is None:
        outputs = channels_of_drive(drive, [channel.name for channel in BODY_CHANNELS if not channel.on_request])
    library = re.sub(r"\W", "_", f"drive_{path.stem}", flags=re.ASCII)
    with (
        refusals_as_errors(path, SimulationError),
        whole_file(path) as file,
        stepping(drive, inputs=inputs, outputs=outputs, device="cpu", step=step, workers=1) as run,
    ):
        _write_fmu(file, run, drive, compiler, library)
    return path


def compiler_command() -> list[str]:
    """Command of the system's C compiler, or SimulationError."""
    named = shlex.split(os.environ.get("CC", ""))
    for words in [named] if named else [[name] for name in COMPILERS]:
        if shutil.which(words[0]):
            return words
    where = f"CC = {named[0]!r} is no program" if named else "none of cc, gcc, clang is here"
    raise SimulationError(f"an FMU needs a C compiler: {where}; install one, or name it by the variable CC")


def _write_fmu(file: IO[bytes], run: SteppedRun, drive: Drive, compiler: Sequence[str], library: str) -> None:
    """Writes the FMU of a run that has not begun."""
    from warpchain.engine.compilation import portable_object
    from warpchain.engine.cpu import CpuEngine, cpu_kernel
    from warpchain.engine.fmu_description import check_names, input_variables, model_description, output_variables
    from warpchain.engine.fmu_image import image_header, launch_image, start_values

    engine, frames, inputs, outputs = run.launch_parts()
    assert isinstance(engine, CpuEngine)
    starts = [start_values(engine, port).tolist() for port in inputs.values()]
    given = [of for port, start in zip(inputs.values(), starts, strict=True) for of in input_variables(port, start)]
    wanted = [variable for port in outputs.values() for variable in output_variables(port, drive)]
    check_names([*given, *wanted])
    image = launch_image(engine, frames)
    code, symbol = portable_object(cpu_kernel("advance", engine.packed, engine.packed.precision))
    ports = [*inputs.values()], [start for of in starts for start in of], [*outputs.values()]
    header = image_header(image, engine, *ports, {"KERNEL": symbol, "IMAGE_FILE": '"drive.image"'})
    digest = hashlib.sha256(header.encode() + image.content + code.read_bytes() + installed_version().encode())
    token = f"{{{digest.hexdigest()[:32]}}}"
    parts = {"drive.h": f'#define TOKEN "{token}"\n{header}'.encode(), "drive.image": bytes(image.content)}
    interval = max(1, round(1.0 / (drive.run.sample_rate * run.step)))
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as fmu:
        for name, content in (
            ("modelDescription.xml", model_description(drive, (library, token), given, wanted, run.step, interval)),
            (f"binaries/{PLATFORM}/{library}.so", _linked_library(compiler, code, parts)),
            ("resources/drive.toml", dumps_drive(drive).encode()),
        ):
            entry = zipfile.ZipInfo(name)  # of one date: the same drive has the same bytes
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o755 << 16
            fmu.writestr(entry, content)


def _linked_library(compiler: Sequence[str], code: Path, parts: dict[str, bytes]) -> bytes:
    """Shared library of an FMU's shell, included files `parts`, and a kernel's object file."""
    with tempfile.TemporaryDirectory(prefix="warpchain-fmu-") as folder:
        for name, content in (parts | {"exported.map": EXPORTED.encode()}).items():
            Path(folder, name).write_bytes(content)
        flags = ["-std=gnu11", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-s", "-I", "."]
        link = ["-Wl,-z,defs", "-Wl,--version-script=exported.map", "-lm", "-o", "fmu.so"]
        words = [*compiler, *flags, str(SHELL), str(code), *link]
        done = subprocess.run(words, cwd=folder, capture_output=True, text=True, errors="replace")
        if done.returncode != 0:
            lines = done.stderr.splitlines() or [f"exit status {done.returncode}"]
            line = next((line for line in lines if "error" in line), lines[-1])
            raise SimulationError(f"{compiler[0]}: cannot make the FMU's library: {line}")
        return Path(folder, "fmu.so").read_bytes()
