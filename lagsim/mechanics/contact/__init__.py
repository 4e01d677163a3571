"""One-sided laws in numbers: which rows hold, and with what impulses and multipliers.

Linear algebra on the Delassus matrix of the rows that could act: no graph, no state.

    delassus  the matrix, beside the equalities that hold
    impact    impulses at rates that are about to violate a gap
    modes     what holds, slides or lets go, from accelerations

Source: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts (1996).
"""

from lagsim.mechanics.contact.complementarity import Closed, Mode
from lagsim.mechanics.contact.delassus import Delassus, delassus
from lagsim.mechanics.contact.impacts import Impact, impact
from lagsim.mechanics.contact.modes import Modes, modes

__all__ = [
    "Closed",
    "Delassus",
    "Impact",
    "Mode",
    "Modes",
    "delassus",
    "impact",
    "modes",
]
