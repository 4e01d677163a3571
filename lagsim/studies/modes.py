"""Small motions about a rest or a steady motion: modes, responses, matrices."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.codes.known import NO_RESPONSE, NOT_FINITE, UNKNOWN_NAME, USAGE
from lagsim.errors import did_you_mean, unusable
from lagsim.language.derivatives import tangent
from lagsim.language.names import member_hint, rate_of
from lagsim.mechanics.linearisation import EigenMode, modes
from lagsim.mechanics.pieces import whole
from lagsim.mechanics.state_space import Input, StateSpace, state_space
from lagsim.model.model import Level
from lagsim.notes import Caution
from lagsim.outputs.manifest import head
from lagsim.outputs.table import table_of
from lagsim.studies.rest import Search, steady_start
from lagsim.studies.setting import Setting, setting_of
from lagsim.tolerances import HALF_OF_DIGITS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from lagsim.language.arrays import Complexes, Floats
    from lagsim.model.model import Model
    from lagsim.studies.rest import Steady

    Document = dict[str, Any]

REST, START = "rest", "start"
MANIFEST = "modes.json"
# Frequencies of a response: their count, and the range beside the modes.
FREQUENCIES, BESIDE = 600, 10.0
# Offsets from each mode, in parts of its damping, and the least damping for these.
AROUND, LEAST_DAMPING = (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0), 1e-3
# Peaks and valleys: the most, their least height over the surroundings, and the
# relative error of their frequencies. With a smaller error an undamped valley would be
# as deep as rounding, and the picture too high.
MOST_PEAKS, LEAST_PEAK, PEAK_ERROR = 8, 1.2, 1e-5
# Relative change of a parameter by which others that follow it are differentiated.
STEP = 1e-4


def pair_of(text: str) -> tuple[str, str] | None:
    """Return input and output of the text `INPUT:OUTPUT`, or None for another text.

    Examples
    --------
    >>> pair_of("F: x"), pair_of("F:"), pair_of("F")
    (('F', 'x'), None, None)
    """
    parts = [part.strip() for part in text.split(":")]
    return (parts[0], parts[1]) if len(parts) == 2 and all(parts) else None


class FrequencyResponse(NamedTuple):
    """Frequency response of outputs to inputs.

    Attributes
    ----------
    frequencies : ndarray, shape (k,)
    pairs : dict of str to ndarray of complex, shape (k,)
        `INPUT:OUTPUT` -> the output per unit of the input.
    """

    frequencies: Floats
    pairs: dict[str, Complexes]

    @property
    def columns(self) -> dict[str, Floats]:
        """The columns (k,) of response.csv by name."""
        found = {"frequency": self.frequencies}
        for name, values in self.pairs.items():
            found[f"{name}.amplitude"] = np.abs(values)
            found[f"{name}.phase"] = np.degrees(np.angle(values))
        return found


class SmallMotions:
    """Small motions of a model about a steady state.

    Parameters
    ----------
    model : Model
    at : str
        `rest` for the nearest rest, `start` for the start of the model.

    Attributes
    ----------
    setting : Setting
    steady : Steady
    modes : tuple of EigenMode
        The modes, by increasing natural frequency.
    """

    def __init__(self, model: Model, at: str = REST) -> None:
        self.setting: Setting = setting_of(model)
        self.steady: Steady = (
            steady_start(self.setting)
            if at == START
            else Search(self.setting).nearest()
        )
        self._own = [*self.setting.cautions, *self.steady.cautions(self.setting)]
        self.cautions = self._own
        self.modes: tuple[EigenMode, ...] = modes(
            self.steady.linear, self.steady.spectrum
        )

    @property
    def document(self) -> Document:
        """The content of modes.json."""
        steady = self.steady
        found = head(self.setting.model) | {
            "about": steady.record,
            "modes": [self._record(mode) for mode in self.modes],
            "zero": steady.spectrum.zero,
        }
        if self.cautions:
            found["warnings"] = [c.record for c in self.cautions]
        return found

    def _record(self, mode: EigenMode) -> Document:
        e = self.steady.equations
        found = {
            "eigenvalue": _pair(mode.eigenvalue),
            "frequency": mode.frequency,
            "natural_frequency": mode.natural_frequency,
            "damping": mode.damping_ratio + 0.0,
            "stable": mode.stable,
            "shape": dict(zip(e.q, map(_pair, mode.shape), strict=True)),
        }
        if e.states:
            names = [x.name for x in e.states]
            found["states"] = dict(zip(names, map(_pair, mode.states), strict=True))
        return found

    # Inputs, outputs, and the matrices between them

    @cached_property
    def inputs(self) -> dict[str, Input]:
        """The inputs by name: entries of `forces`, parameters and constraints."""
        steady, model = self.steady, self.setting.model
        g, flow, found = model.graph, steady.equations.flow, dict[str, Input]()
        for k, row in enumerate(steady.equations.rows):
            found[whole(row.name)] = Input(whole(row.name), row=k)
        for p in model.parameters:
            if not p.mode:
                found[p.name] = Input(p.name, parameters={p.name: 1.0})
        for force in model.forces:
            by_rates = force.level is not Level.POSITION
            levers = flow.gradient(g, force.direction, by_rates=by_rates)
            found[force.on] = Input(force.on, levers.entries)
        return found

    @cached_property
    def outputs(self) -> dict[str, int]:
        """The outputs by name: variables of the motion and definitions, as nodes."""
        e, g, model = (
            self.steady.equations,
            self.setting.model.graph,
            self.setting.model,
        )
        own = [*e.q, *e.velocities, *e.accelerations, *(x.name for x in e.states)]
        found = {name: g.variable(name) for name in own}
        found |= {rate_of(x.name): x.rate for x in e.states}
        seed = dict(e.flow.forward)
        for q, rate in zip(e.velocities, e.accelerations, strict=True):
            seed[g.variable(q)] = g.variable(rate)
        for d in model.definitions:
            found[d.name] = node = d.node
            for order in (1, 2) if d.level is Level.POSITION else ():
                (node,) = tangent(g, [node], seed)
                found[rate_of(d.name, order)] = node
        lambdas = {f"lambda_{c.called}": g.zero for c in model.constraints}
        return (
            found
            | lambdas
            | {f"lambda_{r.name}": g.variable(f"lambda_{r.name}") for r in e.rows}
        )

    def input(self, name: str) -> Input:
        """Return the input with a name.

        If it is a parameter, parameters that follow from it change, too.

        Raises
        ------
        InputError
            If there is no such input.
        """
        found: Input = _named_entry(name, self.inputs, "input")
        if not found.parameters:
            return found
        return found._replace(parameters=_followers(self.setting.model, name))

    def matrices(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> StateSpace:
        """Return the linear state space with these inputs and outputs.

        inputs : names of `inputs`; by default all entries of `forces`.
        outputs : names of `outputs`; by default all coordinates and velocities.

        Raises
        ------
        InputError
            If there is no such input or output.
        """
        model, e = self.setting.model, self.steady.equations
        if inputs is None:
            inputs = list(dict.fromkeys(force.on for force in model.forces))
        if outputs is None:
            outputs = [*e.q, *e.velocities]
        chosen = {name: _named_entry(name, self.outputs, "output") for name in outputs}
        steady = self.steady
        try:
            return state_space(
                steady.linearisation, steady.state, [*map(self.input, inputs)], chosen
            )
        except ValueError:
            text = "a slope of an output or by an input is not finite there"
            raise unusable(NOT_FINITE, text) from None

    def response(
        self,
        pairs: Sequence[tuple[str, str]],
        between: tuple[float, float] | None = None,
    ) -> tuple[StateSpace, FrequencyResponse]:
        """Return the matrices and the frequency response of pairs (input, output).

        Parameters
        ----------
        between : (float, float), optional
            The range of frequencies in Hz; by default from a tenth of the lowest
            natural frequency to ten times the highest.

        Raises
        ------
        InputError
            If there is no such input or output, or no range of frequencies.
        """
        inputs = list(dict.fromkeys(x for x, _ in pairs))
        outputs = list(dict.fromkeys(y for _, y in pairs))
        space = self.matrices(inputs, outputs)
        self.cautions = [*self._own, *self._effects(inputs, space)]
        own = [mode.natural_frequency for mode in self.modes]
        if between is None and not own:
            hint = "give one by --frequencies"
            raise unusable(USAGE, "no mode gives a range of frequencies", hint=hint)
        low, high = between or (min(own) / BESIDE, max(own) * BESIDE)
        frequencies = self._frequencies(low, high)
        found = space.response(frequencies)
        entries = [(outputs.index(y), inputs.index(x)) for x, y in pairs]
        infinite = [
            mode.frequency
            for mode in self.modes
            if abs(mode.damping_ratio) < LEAST_DAMPING
        ]
        more = np.array(
            [
                f
                for entry in entries
                for f in _extremes(space, frequencies, found, entry, infinite)
            ]
        )
        more = self._off_poles(np.setdiff1d(more, frequencies))
        places = np.searchsorted(frequencies, more)
        found = np.insert(found, places, space.response(more), axis=0)
        frequencies = np.insert(frequencies, places, more)
        columns = {
            f"{x}:{y}": found[:, i, j]
            for (x, y), (i, j) in zip(pairs, entries, strict=True)
        }
        return space, FrequencyResponse(frequencies, columns)

    def _effects(self, inputs: Sequence[str], space: StateSpace) -> list[Caution]:
        """Return warnings on inputs that are parameters without effect.

        Such a parameter moves neither a state nor an output.

        inputs : names.
        space : the state space from the inputs.
        """
        found, forces = list[Caution](), [x.on for x in self.setting.model.forces]
        for name in inputs:
            own = [k for k, x in enumerate(space.inputs) if x.rstrip("'") == name]
            parts = space.B[:, own], space.D[:, own]
            if self.inputs[name].parameters and not any(x.any() for x in parts):
                text = f"the parameter `{name}` has no effect on small motions about "
                text += "this state: its response is 0"
                if forces:
                    text += f"; entries of `forces` are inputs: {', '.join(forces)}"
                found.append(Caution(NO_RESPONSE, text))
        return found

    def _frequencies(self, low: float, high: float) -> Floats:
        """Return frequencies (k,) from low to high, denser around each mode."""
        found = [np.geomspace(low, high, FREQUENCIES)]
        for mode in self.modes:
            width = max(abs(mode.damping_ratio), LEAST_DAMPING)
            found.append(mode.frequency * (1.0 + width * np.array(AROUND)))
        frequencies = np.unique(np.concatenate(found))
        return self._off_poles(
            frequencies[(frequencies >= low) & (frequencies <= high)]
        )

    def _off_poles(self, frequencies: Floats) -> Floats:
        """Return the frequencies at which the response is finite."""
        poles = np.array([mode.eigenvalue for mode in self.modes])
        distances = np.abs(2j * math.pi * frequencies[:, None] - poles)
        return frequencies[np.all(distances > HALF_OF_DIGITS * np.abs(poles), axis=1)]

    @property
    def rows(self) -> Iterator[Mapping[str, Any]]:
        """The rows of modes.csv."""
        for number, mode in enumerate(self.modes, 1):
            real, imaginary = _pair(mode.eigenvalue)
            found: dict[str, Any] = {
                "mode": number,
                "natural_frequency": mode.natural_frequency,
                "frequency": mode.frequency,
                "damping": mode.damping_ratio + 0.0,
                "re": real,
                "im": imaginary,
                "stable": mode.stable,
            }
            for name, value in zip(
                self._shaped, [*mode.shape, *mode.states], strict=True
            ):
                found[f"{name}.re"], found[f"{name}.im"] = _pair(value)
            yield found

    @property
    def _shaped(self) -> list[str]:
        e = self.steady.equations
        return [*e.q, *(x.name for x in e.states)]

    @property
    def columns(self) -> list[str]:
        """The columns of modes.csv."""
        own = [
            "mode",
            "natural_frequency",
            "frequency",
            "damping",
            "re",
            "im",
            "stable",
        ]
        return own + [
            f"{name}.{part}" for name in self._shaped for part in ("re", "im")
        ]


def peaks(values: Floats) -> list[int]:
    """Return the indices of the largest maxima that stand out, the largest first.

    values : (k,), logarithms of amplitudes; with the opposite sign for valleys.
    """
    inner = (values[1:-1] > values[:-2]) & (values[1:-1] > values[2:])
    tops = (np.flatnonzero(inner) + 1).tolist()
    found = [k for k in tops if _stands_out(values, k) > math.log(LEAST_PEAK)]
    return sorted(found, key=lambda k: -values[k])[:MOST_PEAKS]


def _stands_out(values: Floats, k: int) -> float:
    """Return how far a maximum is above the higher of the minima beside it.

    values : (n,).
    k : the index of the maximum.
    """
    higher = np.flatnonzero(values > values[k])
    left = higher[higher < k].max(initial=0)
    right = higher[higher > k].min(initial=len(values) - 1)
    return float(
        values[k] - max(values[left : k + 1].min(), values[k : right + 1].min())
    )


def logarithms(amplitudes: Floats) -> Floats:
    """Return finite logarithms of amplitudes, which may be 0."""
    return np.asarray(np.log(np.maximum(amplitudes, 1e-300)))


def _extremes(
    space: StateSpace,
    frequencies: Floats,
    found: Complexes,
    entry: tuple[int, int],
    infinite: Sequence[float],
) -> Iterator[float]:
    """Yield the frequencies of the peaks and valleys of an amplitude.

    Their relative error is at most `PEAK_ERROR`.

    frequencies : (k,).
    found : (k, outputs, inputs), the response there.
    entry : output and input.
    infinite : frequencies of undamped modes, whose peaks are left out.
    """
    from scipy.optimize import minimize_scalar

    logs = logarithms(np.abs(found[:, *entry]))
    for sign in (-1.0, 1.0):

        def height(f: float, sign: float = sign) -> float:
            one = space.response(np.array([f]))[0, *entry]
            return float(sign * logarithms(np.abs(one)))

        for k in peaks(-sign * logs):
            low, high = frequencies[k - 1], frequencies[k + 1]
            if sign < 0.0 and any(low <= f <= high for f in infinite):
                continue
            near = {"xatol": PEAK_ERROR * low}
            best = minimize_scalar(
                height, bounds=(low, high), method="bounded", options=near
            )
            yield float(best.x)


def tables(
    small: SmallMotions, response: FrequencyResponse | None = None
) -> dict[str, bytes]:
    """Return the contents of modes.csv and, with a response, response.csv by name."""
    rows = ([row[name] for name in small.columns] for row in small.rows)
    found = {"modes.csv": table_of(small.columns, rows)}
    if response is not None:
        columns = response.columns
        cells = zip(*(x.tolist() for x in columns.values()), strict=True)
        found["response.csv"] = table_of(tuple(columns), cells)
    return found


def _pair(value: complex) -> list[float]:
    return [float(value.real) + 0.0, float(value.imag) + 0.0]


def _named_entry(name: str, among: Mapping[str, Any], kind: str) -> Any:
    """Return the entry of `among` with a name.

    kind : `input` or `output`, for the message.

    Raises
    ------
    InputError
        If there is no entry with that name.
    """
    if name in among:
        return among[name]
    hint = member_hint(name, among) or did_you_mean(name, among)
    hint = hint or f"one of {', '.join(list(among)[:20])}"
    raise unusable(UNKNOWN_NAME, f"`{name}` is no {kind} of the model", hint=hint)


def _followers(model: Model, name: str) -> dict[str, float]:
    """Return the changes of parameters per unit change of the parameter `name`.

    The parameter itself has 1; parameters that do not follow it are left out.
    """
    if not model.stated.depends_on([name]):
        return {name: 1.0}
    value = model.parameter_values[name]
    step = STEP * (abs(value) or 1.0)
    # Central differences of order 4.
    sides = [
        model.bind({name: value + k * step}).parameter_values for k in (-2, -1, 1, 2)
    ]
    found = {}
    for p in model.parameters:
        a, b, c, d = (side[p.name] for side in sides)
        slope = (8.0 * (c - b) - (d - a)) / (12.0 * step)
        if slope:
            found[p.name] = slope
    return found | {name: 1.0}


def matrices_of(space: StateSpace) -> Document:
    """Return the matrices A, B, C, D of x' = A x + B u, y = C x + D u as a document."""
    return {
        key: value.tolist() if isinstance(value, np.ndarray) else list(value)
        for key, value in space._asdict().items()
    }
