"""Document, table and model file of a fit."""

from __future__ import annotations

import hashlib
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.outputs.manifest import head
from lagsim.outputs.table import table_of
from lagsim.studies.fit.data import TIME
from lagsim.studies.fit.fitting import CONVERGED, INTERRUPTED, LIKELY

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.language.arrays import Floats
    from lagsim.studies.fit.fitting import Fit, Found

MANIFEST, TABLE = "fit.json", "fit.csv"


def document_of(fit: Fit, found: Found) -> dict[str, Any]:
    """Return the content of fit.json."""
    labels = [one.label for one in fit.names]
    deviations, correlation = _uncertainties(fit, found)
    wide = deviations * _quantile(fit, found)
    parameters: dict[str, Any] = {}
    for j, one in enumerate(fit.names):
        value = float(found.x[j])
        entry: dict[str, Any] = {
            "value": value, "standard_error": _finite_or_none(deviations[j]),
            "interval": [_finite_or_none(value + w) for w in (-wide[j], wide[j])],
            "start": one.start,
        }  # fmt: skip
        if math.isnan(wide[j]):
            entry["interval"] = None
        if one.label in found.bounded:
            entry["bound"] = found.bounded[one.label]
        parameters[one.label] = entry
    spread = {}
    for k, match in enumerate(fit.matches):
        own = found.raw[fit.of == k]
        spread[match.column] = (
            _finite_or_none(float(np.sqrt(np.mean(own**2)))) if len(own) else None
        )
    noise = dict(zip(spread, found.noise.tolist(), strict=True))
    combinations = found.estimate.combinations if found.estimate else []
    document = head(fit.given) | {
        "data": [_of_record(fit, number) for number in range(len(fit.records))],
        "match": {x.column: x.text for x in fit.matches},
        "loss": fit.loss,
        "parameters": parameters,
        "correlation": {
            a: {b: _finite_or_none(correlation[i, j]) for j, b in enumerate(labels)}
            for i, a in enumerate(labels)
        },
        "rms": spread,
        "noise": noise,
        "identifiable": found.estimate and not combinations,
        "combinations": combinations,
        "chi2": _finite_or_none(float(np.sum((found.raw / found.noise[fit.of]) ** 2))),
        "degrees_of_freedom": len(fit.data) - len(fit.names) + len(combinations),
        "starts": found.starts,
        "reached": found.reached,
        "iterations": fit.iterations,
        "runs": fit.runs,
        "outcome": found.outcome,
        "complete": found.outcome == CONVERGED,
    }
    if found.cautions:
        document["warnings"] = [x.record for x in found.cautions]
    return document


def _finite_or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _uncertainties(fit: Fit, found: Found) -> tuple[Floats, Floats]:
    """Return standard errors (p,) of the varied names, and correlations (p, p)."""
    p = len(fit.names)
    if found.estimate is None:
        return np.full(p, np.nan), np.full((p, p), np.nan)
    covariance = found.estimate.covariance
    sizes = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / np.outer(sizes, sizes)
    return sizes * fit.scales, correlation


def _quantile(fit: Fit, found: Found) -> float:
    """Return the half width of a 95 % interval, as a multiple of the standard error.

    The distribution is the normal one if all standard deviations are given; else
    Student's, with the degrees of freedom of the columns with estimated noise.
    """
    from scipy.special import ndtri, stdtrit

    above = 0.5 + 0.5 * LIKELY
    estimated = np.array([x.deviation == 0.0 for x in fit.matches])[fit.of]
    if not estimated.any() or found.estimate is None:
        return float(ndtri(above))
    free = float(np.sum(1.0 - found.estimate.leverages[estimated]))
    return float(stdtrit(free, above)) if free > 0.5 else math.nan


def _of_record(fit: Fit, number: int) -> dict[str, Any]:
    record, unused = fit.records[number], fit.unused(fit.records[number])
    found = {
        "name": record.name,
        "rows": len(record.times),
        "columns": [x for x in record.columns if x != TIME and x not in unused],
        "unused": unused,
    }
    return found | ({"values": fit.own[number]} if fit.own[number] else {})


def tables(fit: Fit, found: Found) -> dict[str, bytes]:
    """Return {"fit.csv": content}: data, model and residual of each column, by time."""
    header = ["data", TIME]
    for match in fit.matches:
        header += [match.column, f"{match.column}.model", f"{match.column}.residual"]
    rows: list[Sequence[object]] = []
    begin = 0
    for number, (record, measured) in enumerate(
        zip(fit.records, fit.measured, strict=True), 1
    ):
        count = int(np.count_nonzero(measured))
        cells = np.full((*measured.shape, 3), np.nan)
        data, raw = (x[begin : begin + count] for x in (fit.data, found.raw))
        cells[measured] = np.column_stack([data, data + raw, -raw])
        begin += count
        for time, row in zip(record.times.tolist(), cells, strict=True):
            values = (_finite_or_none(x) for x in row.ravel().tolist())
            rows.append([number, time, *values])
    return {TABLE: table_of(header, rows)}


def with_values(fit: Fit, found: Found, given: Mapping[str, Any]) -> str:
    """Return the text of the model file with the values of the fit; comments are kept.

    If a name has a value for each data file (`theta@2`), the value for the first data
    file is written. Values in `given` are written, too.

    Raises
    ------
    InputError
        If a value of a family has no place of its own in the file.
    """
    model, values = fit.given, fit.of_file(found)
    known = model.parameter_values | {x.name: x.value for x in model.initial}
    fixed = {name: known[name] for name in given if name in known}
    return model.stated.rewritten(fixed | values)


def files_of(
    fit: Fit, found: Found, given: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the content of fit.json, and all files except fit.json and the picture.

    given : see `with_values`.
    """
    text = with_values(fit, found, given).encode()
    digests = {name_of(fit): hashlib.sha256(text).hexdigest()}
    document = document_of(fit, found) | {"digests": digests}
    return document, tables(fit, found) | {name_of(fit): text}


def name_of(fit: Fit) -> str:
    """Return the file name for the model with its fitted values: NAME-fitted.yaml."""
    return f"{fit.given.name}-fitted.yaml"


def lines(document: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of the printed table: name, value, standard error, interval."""
    rows: list[tuple[str, ...]] = [("", "value", "standard error", "95 % interval")]
    for name, one in document["parameters"].items():
        error, ends = one["standard_error"], one["interval"]
        between = "not determined" if document["outcome"] != INTERRUPTED else ""
        if ends is not None:
            between = f"{ends[0]:.6g} to {ends[1]:.6g}"
        if "bound" in one:
            between = f"at its {one['bound']} bound"
        shown = f"{error:.3g}" if error is not None else ""
        rows.append((name, f"{one['value']:.8g}", shown, between))
    return rows
