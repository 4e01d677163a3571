"""Pictures of results in the Python interface are blank."""

from tests.blank_pictures import blank_pictures  # noqa: F401  a fixture
