"""The catalogue of effects over HTTP."""

from __future__ import annotations

from service_fakes import API, Running

from fitting.effects import effects


def test_every_registered_effect_is_listed_with_texts_for_people(running: Running) -> None:
    items = running.client.get(f"{API}/effects").json()["items"]
    assert [item["id"] for item in items] == [effect.id for effect in effects()]
    assert len(items) >= 12
    for item in items:
        assert item["title"] and item["equation"] and item["experiment"] and item["source"]
        assert running.client.get(f"{API}/effects/{item['id']}").json() == item


def test_an_unknown_effect_is_404(running: Running) -> None:
    response = running.client.get(f"{API}/effects/magic")
    assert response.status_code == 404
    assert "magic" in response.json()["detail"]
