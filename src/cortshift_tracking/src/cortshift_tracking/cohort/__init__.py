"""Many cases at once: the sheet that names them, one case, and the table and pictures of all."""
