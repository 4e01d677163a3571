"""What follows the rows of a run while they pass, in bounded memory."""
