"""A small importer of FMUs (FMI 3.0, co-simulation) by ctypes, independent of what makes them."""

import ctypes
import math
import zipfile
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint32, c_void_p
from xml.etree import ElementTree

LOG = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
DONE, ERROR = 0, 3


class Fmu:
    """An FMU from a file, unpacked into a folder.

    Attributes:
        description: root of modelDescription.xml.
        references: value references by variables' names.
    """

    def __init__(self, path, folder):
        with zipfile.ZipFile(path) as file:
            file.extractall(folder)
        self.description = ElementTree.parse(folder / "modelDescription.xml").getroot()
        variables = self.description.find("ModelVariables")
        self.references = {each.get("name"): int(each.get("valueReference")) for each in variables}
        self.attributes = {each.get("name"): each.attrib for each in variables}
        name = self.description.find("CoSimulation").get("modelIdentifier")
        self.library = ctypes.CDLL(str(folder / "binaries" / "x86_64-linux" / f"{name}.so"))
        self.step = float(self.description.find("CoSimulation").get("fixedInternalStepSize"))

    def outputs(self):
        """Names of its outputs."""
        return [name for name, each in self.attributes.items() if each["causality"] == "output"]


class Slave:
    """An instance of an FMU; `lines` are what it has logged."""

    def __init__(self, fmu, start=0.0, token=None):
        self.fmu, self.library, self.lines, self.start, self.time = fmu, fmu.library, [], start, start
        self.log = LOG(lambda environment, status, category, message: self.lines.append(message.decode()))
        make = self.library.fmi3InstantiateCoSimulation
        make.restype = c_void_p
        token = fmu.description.get("instantiationToken") if token is None else token
        false = c_bool(False)
        self.handle = make(
            b"one", token.encode(), b"", false, false, false, false, None, c_size_t(0), None, self.log, None
        )
        if self.handle:
            self.handle = c_void_p(self.handle)

    def call(self, name, *arguments, status=DONE):
        """Calls a function of the FMU, which must return `status`."""
        found = getattr(self.library, f"fmi3{name}")(self.handle, *arguments)
        assert found == status, (name, found, self.lines)

    def initialize(self, **values):
        """Goes through initialization, where `values` are set."""
        self.call(
            "EnterInitializationMode", c_bool(False), c_double(0.0), c_double(self.start), c_bool(False), c_double(0.0)
        )
        if values:
            self.set(values)
        self.call("ExitInitializationMode")
        return self

    def set(self, values, status=DONE):
        """Sets inputs by name."""
        count = len(values)
        which = (c_uint32 * count)(*(self.fmu.references[name] for name in values))
        numbers = (c_double * count)(*values.values())
        self.call("SetFloat64", which, c_size_t(count), numbers, c_size_t(count), status=status)

    def get(self, *names):
        """Values of variables, a number or a list."""
        which = (c_uint32 * len(names))(*(self.fmu.references[name] for name in names))
        found = (c_double * len(names))(*([math.nan] * len(names)))
        self.call("GetFloat64", which, c_size_t(len(names)), found, c_size_t(len(names)))
        return found[0] if len(names) == 1 else list(found)

    def do_step(self, size, status=DONE):
        """Makes a communication step; returns the time to which it came."""
        flags, last = [c_bool(True) for _ in range(3)], c_double(math.nan)
        self.call(
            "DoStep", c_double(self.time), c_double(size), c_bool(True), *map(byref, flags), byref(last), status=status
        )
        assert not any(flag.value for flag in flags)
        if status == DONE:
            self.time += size
        return last.value

    def state(self):
        """The instance's state, and its time."""
        kept = c_void_p()
        self.call("GetFMUState", byref(kept))
        return kept, self.time

    def restore(self, state):
        """Takes the instance back to a state."""
        self.call("SetFMUState", state[0])
        self.time = state[1]

    def bytes_of_state(self, state):
        """A state as bytes."""
        size = c_size_t()
        self.call("SerializedFMUStateSize", state[0], byref(size))
        content = (ctypes.c_uint8 * size.value)()
        self.call("SerializeFMUState", state[0], content, size)
        return bytes(content)

    def state_of_bytes(self, content, status=DONE):
        """A state from its bytes, at this instance's time."""
        kept = c_void_p()
        held = (ctypes.c_uint8 * len(content)).from_buffer_copy(content)
        self.call("DeserializeFMUState", held, c_size_t(len(content)), byref(kept), status=status)
        return kept, self.time

    def free(self):
        """Frees the instance."""
        self.library.fmi3FreeInstance(self.handle)
