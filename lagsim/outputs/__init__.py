"""What a run leaves behind: one file per thing written, each whole or not at all."""

from enum import StrEnum


class Format(StrEnum):
    """How a table is kept, which is how its name ends."""

    CSV = "csv"
    NPZ = "npz"
    PARQUET = "parquet"

    @property
    def file(self) -> str:
        """The name of the table of a run."""
        return f"trajectory.{self.value}"
