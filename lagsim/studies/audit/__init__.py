"""Audit of a run: whether its rows are a motion of the model.

`evidence` collects residuals and energies of the rows, with their error bar;
`balances` has the energy balances of decoupled groups; `alarms` are the warnings, and
`finding` is the reason for which rows are rejected and the run is repeated.
"""
