"""Tables of paired devices, API keys and pairing codes."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

#: Paired devices and API keys; of what they send only a hash is kept.
principals = sa.Table(
    "principals",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("kind", sa.String, nullable=False),  # device, key
    sa.Column("name", sa.String, nullable=False),
    sa.Column("role", sa.String, nullable=False),
    sa.Column("machines", sa.JSON(none_as_null=True)),  # none: all
    sa.Column("secret_sha256", sa.String, nullable=False, unique=True),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("created_by", sa.String, nullable=False),
    sa.Column("expires", sa.String),  # none: never
)

pairing_codes = sa.Table(
    "pairing_codes",
    metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("code_hash", sa.String, nullable=False),  # Argon2id: six digits are soon tried with a quick hash
    sa.Column("role", sa.String, nullable=False),
    sa.Column("machines", sa.JSON(none_as_null=True)),
    sa.Column("created_by", sa.String, nullable=False),
    sa.Column("expires", sa.String, nullable=False),
    sa.Column("failures", sa.Integer, nullable=False),  # wrong codes that came while it was open
    sa.Column("days", sa.Integer),  # that the device's token is good for
)
