"""Tables of identifications of valves and of the recordings that they are made of."""

from __future__ import annotations

import sqlalchemy as sa

from server.identifications.identification_tables import fit_table, recordings_table

valves = fit_table("valves", sa.Column("axes", sa.JSON))
valve_recordings = recordings_table("valve", "valves")
