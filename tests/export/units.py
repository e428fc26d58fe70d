"""Functional mock-up units, unpacked, and called through the functions of the standard as importers do."""

import ctypes
import platform
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from codegen.c_programs import compiler

VERSIONS = ("2.0", "3.0")
Reference = ctypes.c_uint


def unpacked(model, path, **options):
    """Export a unit; return its description and the folder that it is unpacked to."""
    model.export(path, "fmu", **options)
    folder = path.parent / path.stem
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return ElementTree.parse(folder / "modelDescription.xml").getroot(), folder


def variables_of(description):
    """Return the variables of a description, of either version."""
    return list(description.find("ModelVariables"))


def _doubles(values):
    return (ctypes.c_double * len(values))(*values)


class Unit:
    """An instance of a unit, for co-simulation, with `events` in FMI 3.0, or for model exchange."""

    def __init__(self, description, folder, exchange=False, events=False):
        if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
            pytest.skip("the test knows the folder of binaries of this platform alone")
        compiler()
        self.version = description.get("fmiVersion")
        name = description.find("CoSimulation").get("modelIdentifier")
        where = "linux64" if self.version == "2.0" else "x86_64-linux"
        self.library = ctypes.CDLL(str(folder / "binaries" / where / f"{name}.so"))
        self.numbers = {v.get("name"): int(v.get("valueReference")) for v in variables_of(description)}
        self.token = description.get("guid") or description.get("instantiationToken")
        self.n_states = len(description.findall(".//Derivatives/*")) or len(
            description.findall(".//ContinuousStateDerivative")
        )
        self.exchange, self.events, self.early_return = exchange, events, events
        self.instance = self.instantiated(self.token)

    def instantiated(self, token):
        """Return the address of a new instance, None where the unit rejects it."""
        if self.version == "2.0":
            make = self.library.fmi2Instantiate
            make.restype = ctypes.c_void_p
            return make(b"unit", 0 if self.exchange else 1, token.encode(), b"", None, 0, 0)
        kind = "ModelExchange" if self.exchange else "CoSimulation"
        make = getattr(self.library, f"fmi3Instantiate{kind}")
        make.restype = ctypes.c_void_p
        further = () if self.exchange else (self.events, self.early_return, None, ctypes.c_size_t(0))
        callbacks = (None, None) if self.exchange else (None, None, None)
        return make(b"unit", token.encode(), b"", False, False, *further, *callbacks)

    def call(self, name, *arguments):
        """Call a function of the standard by its name of FMI 3.0; return the status."""
        if self.version == "2.0":
            name = _NAMES.get(name, name.replace("FMUState", "FMUstate"))
        return getattr(self.library, f"fmi{self.version[0]}{name}")(ctypes.c_void_p(self.instance), *arguments)

    def begin(self, t, **values):
        """Initialize at a time with values; return the status."""
        zero = ctypes.c_double(0)
        if self.version == "2.0":
            assert self.call("SetupExperiment", 0, zero, ctypes.c_double(t), 0, zero) == 0
            assert self.call("EnterInitializationMode") == 0
        else:
            assert self.call("EnterInitializationMode", False, zero, ctypes.c_double(t), False, zero) == 0
        for name, value in values.items():
            self.set(name, value)
        return self.call("ExitInitializationMode")

    def set(self, name, value):
        """Set a variable; return the status."""
        further = () if self.version == "2.0" else (ctypes.c_size_t(1),)
        given = (Reference * 1)(self.numbers[name]), ctypes.c_size_t(1), _doubles([value]), *further
        return self.call("SetFloat64", *given)

    def slope(self, name, value):
        """Set the slope of an input."""
        given = (Reference * 1)(self.numbers[name]), ctypes.c_size_t(1), (ctypes.c_int * 1)(1), _doubles([value])
        assert self.call("SetRealInputDerivatives", *given) == 0

    def get(self, name):
        """Return the value of a variable."""
        value, further = _doubles([0.0]), () if self.version == "2.0" else (ctypes.c_size_t(1),)
        given = (Reference * 1)(self.numbers[name]), ctypes.c_size_t(1), value, *further
        assert self.call("GetFloat64", *given) == 0
        return value[0]

    def step(self, t, size):
        """Take a communication step; return the status."""
        given = ctypes.c_double(t), ctypes.c_double(size)
        if self.version == "2.0":
            return self.call("DoStep", *given, 1)
        flags, last = [ctypes.c_bool(True) for _ in range(3)], ctypes.c_double()
        status = self.call("DoStep", *given, True, *map(ctypes.byref, flags), ctypes.byref(last))
        assert not any(flag.value for flag in flags) and (status or last.value == pytest.approx(t + size))
        return status

    def early(self, t, size):
        """Take a communication step of FMI 3.0 with events; return its time, and whether it needs one and is early."""
        event, ended, early, last = *(ctypes.c_bool(True) for _ in range(3)), ctypes.c_double()
        given = (*map(ctypes.byref, (event, ended, early)), ctypes.byref(last))
        assert self.call("DoStep", ctypes.c_double(t), ctypes.c_double(size), True, *given) == 0
        assert not ended.value
        return last.value, event.value, early.value

    def ended(self, t, size):
        """Take a communication step that an event ends; return the time of that, and whether the step ended early."""
        last, given = ctypes.c_double(), (ctypes.c_double(t), ctypes.c_double(size))
        if self.version == "2.0":
            ended = ctypes.c_int()
            assert self.call("DoStep", *given, 1) == 2
            assert self.call("GetBooleanStatus", 3, ctypes.byref(ended)) == 0 and ended.value
            assert self.call("GetRealStatus", 2, ctypes.byref(last)) == 0
            return last.value, False
        event, end, early = (ctypes.c_bool(True) for _ in range(3))
        assert self.call("DoStep", *given, True, *map(ctypes.byref, (event, end, early, last))) == 0
        assert end.value and not event.value
        return last.value, early.value

    def again(self):
        """Save the state of the unit, serialize it, and return a function that restores it from its bytes."""
        saved, size = ctypes.c_void_p(), ctypes.c_size_t()
        assert self.call("GetFMUState", ctypes.byref(saved)) == 0
        assert self.call("SerializedFMUStateSize", saved, ctypes.byref(size)) == 0
        data = ctypes.create_string_buffer(size.value)
        assert self.call("SerializeFMUState", saved, data, size) == 0
        assert self.call("FreeFMUState", ctypes.byref(saved)) == 0 and not saved

        def restore():
            state = ctypes.c_void_p()
            assert self.call("DeserializeFMUState", data, size, ctypes.byref(state)) == 0
            assert self.call("SetFMUState", state) == 0
            assert self.call("FreeFMUState", ctypes.byref(state)) == 0

        return restore

    def directional(self, unknown, known, seed):
        """Return derivatives of variables by others along a seed."""
        found, counts = _doubles([0.0] * len(unknown)), (ctypes.c_size_t(len(unknown)), ctypes.c_size_t(len(known)))
        of, by = ((Reference * len(names))(*(self.numbers[name] for name in names)) for names in (unknown, known))
        values = (_doubles(seed), found) if self.version == "2.0" else (_doubles(seed), counts[1], found, counts[0])
        status = self.call("GetDirectionalDerivative", of, counts[0], by, counts[1], *values)
        return np.array(found) if status == 0 else status

    # -- model exchange ---------------------------------------------------------------------

    def place(self, t, state):
        """Set the time and the continuous states."""
        assert self.call("SetTime", ctypes.c_double(t)) == 0
        assert self.call("SetContinuousStates", _doubles(state), ctypes.c_size_t(len(state))) == 0

    def vector(self, name, count=None):
        """Return the numbers that a function gives: states, their derivatives, nominal values or indicators."""
        count = self.n_states if count is None else count
        found = _doubles([0.0] * count)
        assert self.call(name, found, ctypes.c_size_t(count)) == 0
        return np.array(found)

    def rate(self, t, state):
        """Return the derivative of the continuous states."""
        self.place(t, state)
        return self.vector("GetContinuousStateDerivatives")

    def completed(self):
        """End a step of the integrator; return whether the unit asks for an event, and for the end."""
        kind = ctypes.c_int if self.version == "2.0" else ctypes.c_bool
        event, end = kind(), kind()
        assert self.call("CompletedIntegratorStep", 1, ctypes.byref(event), ctypes.byref(end)) == 0
        return bool(event.value), bool(end.value)

    def updated(self, next_time=None):
        """Update discrete states; return whether the unit asks for the end, and whether it has changed the state.

        The time of its next event is checked.
        """
        if self.version == "2.0":
            info = (ctypes.c_int * 8)()  # five flags, and a double that is aligned
            assert self.call("NewDiscreteStates", info) == 0
            assert not info[0] and not info[2] and bool(info[4]) == (next_time is not None)
            assert next_time is None or np.frombuffer(info, np.float64)[3] == pytest.approx(next_time)
            return bool(info[1]), bool(info[3])
        flags, next_time_found = [ctypes.c_bool() for _ in range(5)], ctypes.c_double()
        assert self.call("UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(next_time_found)) == 0
        again, end, nominals, values, defined = (flag.value for flag in flags)
        assert not again and not nominals and defined == (next_time is not None)
        assert next_time is None or next_time_found.value == pytest.approx(next_time)
        return end, values

    def integrate(self, t, end, steps, inputs=lambda unit, t: None):
        """Integrate by the method of Runge and Kutta of order 4, with events; return how many there were.

        It ends early where the unit asks for it.
        """
        h, events, state = (end - t) / steps, 0, self.vector("GetContinuousStates")
        for k in range(steps):
            at = t + k * h
            rates = [self._rate(at, state, inputs)]
            for part in (0.5, 0.5, 1.0):
                rates.append(self._rate(at + part * h, state + part * h * rates[-1], inputs))
            state = state + h / 6 * (rates[0] + 2 * rates[1] + 2 * rates[2] + rates[3])
            self.place(at + h, state)
            inputs(self, at + h)
            event, ended = self.completed()
            if ended:
                break
            if event:
                events += 1
                assert self.call("EnterEventMode") == 0
                ended, changed = self.updated()
                assert changed and not ended
                assert self.call("EnterContinuousTimeMode") == 0
                state = self.vector("GetContinuousStates")
        return events

    def _rate(self, t, state, inputs):
        inputs(self, t)
        return self.rate(t, state)


_NAMES = {
    "SetFloat64": "SetReal",
    "GetFloat64": "GetReal",
    "DeserializeFMUState": "DeSerializeFMUstate",
    "GetContinuousStateDerivatives": "GetDerivatives",
}
"""Names of functions in FMI 2.0 that have others in FMI 3.0."""
