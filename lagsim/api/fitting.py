"""Fits of a model to measured data in the Python interface."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

from lagsim.api import given, in_python, whole_number, with_settings
from lagsim.api.analysing import Analysis
from lagsim.api.models import Model, model_of
from lagsim.outputs.notebook import heading, html_table, paragraphs, picture, text_block
from lagsim.outputs.results import Results
from lagsim.studies.fit import report
from lagsim.studies.fit.data import read_record, record_of
from lagsim.studies.fit.estimate import LINEAR, LOSSES
from lagsim.studies.fit.fitting import Fit
from lagsim.studies.options import RUNS_OF_FITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.studies.fit.data import Record
    from lagsim.studies.fit.fitting import Found


class FitRuns(TypedDict, total=False):
    """Keys of `simulation` for the runs of a fit, with types."""

    duration: float | str | None
    method: str | None
    formulation: str | None
    atol: float | str | None


class Fitted(Analysis):
    """Values found by a fit. The keys of `lagsim fit --json` are attributes.

    Attributes
    ----------
    parameters : dict
        By name: `value`, `standard_error`, `interval` (at 95 %), `start`.
    correlation : dict
        Correlation of two names: `correlation[name][other]`.
    rms, noise : dict of str to float
        By column: root mean square of the residuals, and standard deviation of the
        measurements, given or estimated.
    identifiable : bool
        Whether the data determine all values.
    combinations : list of dict
        Relative changes of names that leave all columns as they are.
    chi2 : float
    degrees_of_freedom : int
    outcome : str

    Examples
    --------
    >>> import lagsim
    >>> import numpy as np
    >>> t = np.linspace(0.1, 4, 40)
    >>> found = lagsim.fit('''
    ... name: spring
    ... parameters: {k: 3}
    ... coordinates: {x: {}}
    ... energy: {kinetic: x_dot^2/2, potential: k*x^2/2}
    ... initial: {x: 1}
    ... simulation: {duration: 5}
    ... ''', {"t": t, "x": np.cos(2 * t)}, vary=["k"])
    >>> round(found.values["k"], 9), found.identifiable, found.outcome
    (4.0, True, 'converged')
    """

    parameters: dict[str, Any]
    correlation: dict[str, dict[str, float | None]]
    rms: dict[str, float]
    noise: dict[str, float]
    identifiable: bool
    combinations: list[dict[str, float]]
    chi2: float
    degrees_of_freedom: int
    outcome: str

    def __init__(self, fit: Fit, found: Found) -> None:
        document, self._contents = report.files_of(fit, found, {})
        super().__init__(document)
        self._fit, self._found = fit, found

    @property
    def values(self) -> dict[str, float]:
        """The values found, by name."""
        return {name: one["value"] for name, one in self.parameters.items()}

    @property
    def fitted(self) -> Model:
        """The model with the fitted values.

        Start values that each data file has of its own are those of the first file.
        """
        with in_python():
            return model_of(self._fit.given.bind(**self._fit.of_file(self._found)))

    def write(self, folder: str | Path, *, plots: bool = True) -> None:
        """Write the files of `lagsim fit`.

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
        contents = dict(self._contents)
        Results(Path(folder), report.MANIFEST).refuse_changed(report.name_of(self._fit))
        if plots:
            contents["fit.png"] = self._drawn()
        self._write(folder, report.MANIFEST, contents)

    def _drawn(self) -> bytes:
        from lagsim.studies.fit.chart import chart

        return chart(self._fit, self._found)

    def __repr__(self) -> str:
        return text_block(self._heading(), self._lines())

    def _heading(self) -> str:
        return f"Fit of {self.record['model']['name']}: {self.outcome}"

    def _lines(self) -> list[tuple[str, str]]:
        found = []
        for name, one in self.parameters.items():
            error = one["standard_error"]
            known = f" ± {error:.3g}" if error is not None else ""
            found.append((name, f"{one['value']:.8g}{known}"))
        return found

    def _repr_html_(self) -> str:
        name = self.record["model"]["name"]
        return paragraphs(
            heading(self._heading()),
            html_table(self._lines()),
            picture(self._drawn(), f"data and model of {name}"),
        )


@with_settings(RUNS_OF_FITS, before="jobs")
def fit(
    model: Model | str | Path,
    data: Any,
    vary: Sequence[str],
    match: Mapping[str, str] | None = None,
    loss: str = LINEAR,
    starts: int = 0,
    *,
    values: Mapping[str, float | str] | None = None,
    jobs: int | None = None,
    **options: Unpack[FitRuns],
) -> Fitted:
    """Return the values with which a model explains measured data.

    Parameters
    ----------
    model : Model, str or Path
        A model from `load`, the path of a model file, or the text of one: a string
        with a line break.
    data : str, Path, mapping or DataFrame, or a list of these
        CSV files, or arrays by names of columns: `t`, and measurements; nan is a gap.
    vary : sequence of str
        Parameters and start values, with bounds if any: `["k", "c=0:1"]`; `theta@2` is
        that of the second data alone, `t0` the difference of the clocks.
    match : mapping of str to str, optional
        What columns measure: `{"angle": "theta*180/pi:0.5"}`, with the standard
        deviation after `:`, if it is known. Columns with the name of a coordinate,
        rate, state or definition need none.
    loss : str
        `linear`, or for outliers `soft_l1` or `huber`.
    starts : int
        The number of random starts within the bounds, in addition to the start of the
        file.
    values : mapping of str to float or str, optional
        Parameters and start values of one file alone: `{"theta@2": 0.3}`; `t0@2` is the
        difference of its clock.
    jobs : int, optional
        The number of processes; by default one for each core, where that saves time.

    Returns
    -------
    Fitted

    Raises
    ------
    InputError
        If the model or the data have faults, or a name cannot be used.
    LagsimError
        If the start is not admissible.

    Examples
    --------
    >>> import lagsim
    >>> found = lagsim.fit('''
    ... name: fall
    ... parameters: {g: 9}
    ... coordinates: {y: {}}
    ... energy: {kinetic: y_dot^2/2, potential: g*y}
    ... initial: {y: 2}
    ... simulation: {duration: 1}
    ... ''', {"t": [0.2, 0.4, 0.6], "cm": [180.4, 121.5, 23.4]},
    ... vary=["g"], match={"cm": "100*y"})
    >>> round(found.values["g"], 2), round(found.parameters["g"]["standard_error"], 2)
    (9.81, 0.0)
    """
    if loss not in LOSSES:
        raise ValueError(f"loss={loss!r:.60}: one of {', '.join(LOSSES)} is expected")
    whole_number("starts", starts)
    settings = {key: str(x) for key, x in given(options, RUNS_OF_FITS).items()}
    names = [vary] if isinstance(vary, str) else [*vary]
    tables = data if isinstance(data, (list, tuple)) else [data]
    with in_python():
        records = [_record(one, number) for number, one in enumerate(tables, 1)]
        study = Fit(
            model_of(model), records, names, match, loss, options=settings,
            own={name: str(x) for name, x in (values or {}).items()}, jobs=jobs,
        )  # fmt: skip
        return Fitted(study, study.found(starts))


def _record(data: Any, number: int) -> Record:
    if isinstance(data, (str, Path)):
        return read_record(Path(data))
    if isinstance(data, Mapping) or hasattr(data, "columns"):
        return record_of(f"data {number}", data)
    text = "data are the path of a CSV file, or arrays by names of columns"
    raise TypeError(f"{text}: this is {data!r:.60}")
