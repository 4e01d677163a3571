"""Positions of rest and small motions of a model in the Python interface."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagsim.api import in_python, number_range, whole_number
from lagsim.api.models import Model, model_of
from lagsim.errors import counted
from lagsim.outputs.manifest import encode
from lagsim.outputs.notebook import heading, html_table, paragraphs, picture, text_block
from lagsim.outputs.results import open_results
from lagsim.studies import branches as branching
from lagsim.studies import modes as small_motions
from lagsim.studies import rest
from lagsim.studies.modes import REST, START, SmallMotions
from lagsim.studies.options import FREQUENCY_RANGE, VARIED_RANGE
from lagsim.studies.setting import setting_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.mechanics.state_space import StateSpace
    from lagsim.studies.branches import Branches


class Analysis:
    """Result of a study; the entries of its document are attributes of the object.

    Attributes
    ----------
    record : dict
        The document of the command with `--json`.
    """

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = dict(record)

    def __getattr__(self, name: str) -> Any:
        record: dict[str, Any] = self.__dict__.get("record", {})
        if name not in record:
            raise AttributeError(f"there is no entry `{name}`")
        return record[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.record]

    def _write(
        self, folder: str | Path, manifest: str, contents: Mapping[str, bytes]
    ) -> None:
        with open_results(Path(folder), manifest) as results:
            for name, content in contents.items():
                results.write(name, content)
            files = {"files": [*results.names, manifest]}
            results.commit(encode(self.record | files))


class Modes(Analysis):
    """Modes of small motions. The keys of `lagsim modes --json` are attributes.

    Attributes
    ----------
    about : dict
        The state about which the motions are small: t, coordinates, rates and states.
    modes : list of dict
        `eigenvalue`, `frequency`, `natural_frequency`, `damping`, `stable`, `shape`.
    zero : int
        The number of eigenvalues that are 0, which are left out of `modes`.
    response : dict of str to ndarray
        The columns of response.csv; empty without a response.

    Examples
    --------
    >>> import lagsim
    >>> found = lagsim.modes('''
    ... name: spring
    ... coordinates: {x: {}}
    ... energy: {kinetic: x_dot^2/2, potential: 2*x^2}
    ... initial: {x: 1}
    ... ''')
    >>> found.about["x"], found.zero, len(found.modes)
    (0.0, 0, 1)
    """

    about: dict[str, float]
    modes: list[dict[str, Any]]
    zero: int

    def __init__(
        self, small: SmallMotions, response: small_motions.FrequencyResponse | None
    ) -> None:
        super().__init__(small.document)
        self._small, self._response = small, response
        self.response: dict[str, Floats] = response.columns if response else {}

    def matrices(
        self, inputs: Sequence[str] | None = None, outputs: Sequence[str] | None = None
    ) -> StateSpace:
        """Return the linear state space, with the names of states, inputs and outputs.

        Its matrices A, B, C, D are those of x' = A x + B u, y = C x + D u.

        Parameters
        ----------
        inputs : sequence of str, optional
            Entries of `forces`, parameters or constraints; by default all forces.
        outputs : sequence of str, optional
            Coordinates, rates, accelerations, definitions or multipliers; by default
            all coordinates and rates.

        Raises
        ------
        InputError
            If there is no such input or output.
        """
        with in_python():
            return self._small.matrices(inputs, outputs)

    def write(self, folder: str | Path, *, plots: bool = True) -> None:
        """Write the files of `lagsim modes`.

        Parameters
        ----------
        folder : str or Path
        plots : bool
            Whether pictures are written, too.

        Raises
        ------
        InputError
            If the folder cannot be used.
        OSError
            If the disk is full; the folder is then left unchanged.
        """
        from lagsim.outputs.animation import NAME
        from lagsim.studies.modes_drawing import drawings

        contents = small_motions.tables(self._small, self._response)
        for name, draw in drawings(self._small, self._response, plots=plots).items():
            if name != NAME:
                contents[name] = draw()
        self._write(folder, small_motions.MANIFEST, contents)

    def __repr__(self) -> str:
        head = f"{self.record['model']['name']}: {counted(len(self.modes), 'mode')}"
        return text_block(head, self._summary())

    def _summary(self) -> list[tuple[str, str]]:
        return [
            (str(k), f"{x['natural_frequency']:.6g} Hz, damping {x['damping']:.3g}")
            for k, x in enumerate(self.modes[:12], 1)
        ]

    def _repr_html_(self) -> str:
        from lagsim.studies.modes_drawing import picture as drawn

        name = self.record["model"]["name"]
        return paragraphs(
            heading(f"{name}: {counted(len(self.modes), 'mode')}"),
            html_table(self._summary()),
            picture(drawn(self._small), f"the modes of {name}"),
        )


class Equilibria(Analysis):
    """Positions of rest. The keys of `lagsim equilibrium --json` are attributes.

    Attributes
    ----------
    equilibria : list of dict
        The nearest first: `coordinates`, `definitions`, `lambda`, `energy`, `stable`,
        `reason`, `eigenvalues`, `distance`, `from_start`.
    free : list of str
        Coordinates that no force depends on.
    continuum : bool
        Whether friction that sticks holds other positions, too.

    Examples
    --------
    >>> import lagsim
    >>> found = lagsim.equilibrium('''
    ... name: pendulum
    ... coordinates: {theta: {unit: rad}}
    ... energy: {kinetic: theta_dot^2/2, potential: -cos(theta)}
    ... initial: {theta: 0.3}
    ... ''')
    >>> [round(x["coordinates"]["theta"], 6) for x in found.equilibria]
    [0.0, 3.141593]
    >>> [x["stable"] for x in found.equilibria]
    [True, False]
    """

    equilibria: list[dict[str, Any]]
    free: list[str]
    continuum: bool

    def __init__(
        self,
        search: rest.Search,
        found: Sequence[rest.Equilibrium],
        branches: Branches | None = None,
    ) -> None:
        record = rest.document_of(search.setting, found, search.tried)
        super().__init__(record | (branches.record if branches else {}))
        self._search, self._found, self._branches = search, found, branches

    def write(self, folder: str | Path, *, plots: bool = True) -> None:
        """Write the files of `lagsim equilibrium`.

        Parameters
        ----------
        folder : str or Path
        plots : bool
            Whether pictures are written, too.

        Raises
        ------
        InputError
            If the folder cannot be used.
        OSError
            If the disk is full; the folder is then left unchanged.
        """
        contents = rest.tables(self._found)
        if self._branches is not None:
            contents = branching.tables(self.record)
        if plots:
            contents["equilibrium.png"] = self._drawn()
        self._write(folder, rest.MANIFEST, contents)

    def _drawn(self) -> bytes:
        from lagsim.studies.rest_drawing import diagram
        from lagsim.studies.rest_drawing import picture as drawn

        if self._branches is not None:
            return diagram(self._search.setting.model, self.record)
        return drawn(self.record["model"]["name"], self._found)

    def __repr__(self) -> str:
        count = counted(len(self.equilibria), "position")
        return text_block(
            f"{self.record['model']['name']}: {count} of rest", self._lines()
        )

    def _lines(self) -> list[tuple[str, str]]:
        words = {True: "stable", False: "unstable", None: "not decided"}
        found = []
        for k, x in enumerate(self.equilibria[:12], 1):
            where = ", ".join(f"{q} {v:.5g}" for q, v in x["coordinates"].items())
            found.append((str(k), f"{words[x['stable']]}: {where}"))
        return found

    def _repr_html_(self) -> str:
        name = self.record["model"]["name"]
        count = counted(len(self.equilibria), "position")
        return paragraphs(
            heading(f"{name}: {count} of rest"),
            html_table(self._lines()),
            picture(self._drawn(), f"the positions of rest of {name}"),
        )


def equilibrium(
    model: Model | str | Path,
    starts: int = rest.STARTS,
    vary: Mapping[str, tuple[float, float]] | None = None,
) -> Equilibria:
    """Return the positions of rest of a model, and whether they are stable.

    Parameters
    ----------
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.
    starts : int
        The number of starts of the search in addition to the start of the file.
    vary : mapping of str to (float, float), optional
        One parameter or start value with its range: the branches of rests over it are
        followed, and `branches` and `points` are entries of the result.

    Returns
    -------
    Equilibria

    Raises
    ------
    InputError
        If the model has faults.
    LagsimError
        If no position of rest is found.

    Examples
    --------
    >>> import lagsim
    >>> found = lagsim.equilibrium('''
    ... name: spring
    ... coordinates: {x: {}}
    ... energy: {kinetic: x_dot^2/2, potential: (x - 2)^2}
    ... initial: {x: 1}
    ... ''')
    >>> found.equilibria[0]["coordinates"], found.equilibria[0]["stable"]
    ({'x': 2.0}, True)
    """
    whole_number("starts", starts)
    if vary is not None and len(vary) != 1:
        raise ValueError("vary: one name with its range is expected")
    ends = [(x, number_range(x, y, VARIED_RANGE)) for x, y in (vary or {}).items()]
    with in_python():
        read = model_of(model)
        search = rest.Search(setting_of(read))
        if vary is None:
            return Equilibria(search, search.all(starts))
        branches = branching.varied(read, *ends[0])
        return Equilibria(search, branches.follow(starts), branches)


def modes(
    model: Model | str | Path,
    at: str = REST,
    response: Sequence[str] = (),
    frequencies: tuple[float, float] | None = None,
) -> Modes:
    """Return the modes of small motions about a rest or a steady motion.

    Parameters
    ----------
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.
    at : str
        `rest`: the nearest position of rest; `start`: the start, which is at rest or
        in steady motion.
    response : sequence of str
        Pairs `INPUT:OUTPUT` of a frequency response.
    frequencies : (float, float), optional
        The range of frequencies of the response, in Hz.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        If the model has faults, or a name cannot be used.
    LagsimError
        If no rest is found, or the start is not in steady motion.

    Examples
    --------
    >>> import lagsim
    >>> found = lagsim.modes('''
    ... name: spring
    ... coordinates: {x: {}}
    ... energy: {kinetic: x_dot^2/2, potential: 2*x^2}
    ... forces: {x: 0}
    ... initial: {x: 1}
    ... ''')
    >>> [round(mode["frequency"], 6) for mode in found.modes]
    [0.31831]
    >>> found.matrices().A
    array([[ 0.,  1.],
           [-4.,  0.]])
    """
    if at not in (REST, START):
        raise ValueError(f"at={at!r:.60}: 'rest' or 'start' is expected")
    pairs = list[tuple[str, str]]()
    for text in response:
        pair = small_motions.pair_of(text)
        if pair is None:
            raise ValueError(f"response={text!r:.60}: 'INPUT:OUTPUT' is expected")
        pairs.append(pair)
    if frequencies is not None:
        frequencies = number_range("frequencies", frequencies, FREQUENCY_RANGE)
    with in_python():
        small = SmallMotions(model_of(model), at)
        found = small.response(pairs, frequencies)[1] if pairs else None
    return Modes(small, found)
