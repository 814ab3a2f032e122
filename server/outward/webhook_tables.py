"""Tables of webhooks and of what is delivered to them."""

from __future__ import annotations

import sqlalchemy as sa

from server.platform.database.schema import metadata

webhooks = sa.Table(
    "webhooks",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("label", sa.String, nullable=False),
    sa.Column("url", sa.String, nullable=False),
    sa.Column("events", sa.JSON, nullable=False),  # types of messages
    sa.Column("secret_sha256", sa.String, nullable=False),  # tells whether this computer has the secret
    sa.Column("created", sa.String, nullable=False),
    sa.Column("created_by", sa.String, nullable=False),
)

webhook_deliveries = sa.Table(
    "webhook_deliveries",
    metadata,
    sa.Column("number", sa.Integer, primary_key=True),
    sa.Column("id", sa.String, nullable=False, unique=True),
    sa.Column("webhook", sa.String, sa.ForeignKey("webhooks.id", ondelete="CASCADE"), nullable=False, index=True),
    sa.Column("message", sa.String, nullable=False),  # id of the message, for the receiver
    sa.Column("type", sa.String, nullable=False),
    sa.Column("body", sa.Text, nullable=False),  # what is signed and sent
    sa.Column("state", sa.String, nullable=False, index=True),  # pending, delivered, given_up
    sa.Column("tries", sa.Integer, nullable=False),
    sa.Column("error", sa.String),  # of the last try
    sa.Column("created", sa.String, nullable=False),
    sa.Column("ended", sa.String),
    info={"label": "type"},
)
