"""Behind a real nginx that adds TLS and a path, with the lines that docs/access.md gives for it."""

from __future__ import annotations

import json
import re
import shutil
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import httpx2
import pytest
from acquired_machines import named
from service_fakes import API, recording_bytes

from server.platform.files import DataDirectory
from server.platform.settings import Settings
from server.platform.tls import certificate

ROOT = Path(__file__).parents[3]
NGINX = shutil.which("nginx", path="/usr/sbin:/usr/local/sbin:/usr/bin:/bin")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        NGINX is None, reason="there is no nginx; where Debian's packages can be had: apt-get install nginx"
    ),
]
LONG_S = 120.0
FRAME = """
daemon off; master_process off; pid {at}/pid; error_log stderr; worker_processes 1;
events {{}}
http {{
    access_log off;
    client_body_temp_path {at}/body; proxy_temp_path {at}/proxy; fastcgi_temp_path {at}/fastcgi;
    uwsgi_temp_path {at}/uwsgi; scgi_temp_path {at}/scgi;
    map $http_upgrade $connection_upgrade {{ default upgrade; "" close; }}
    server {{
        listen 127.0.0.1:{port} ssl;
        ssl_certificate {crt}; ssl_certificate_key {key};
        {location}
    }}
}}
"""


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, str, httpx2.Client]]:
    """The address behind nginx, what the service printed, and a client that believes nginx's certificate."""
    at, data = tmp_path_factory.mktemp("nginx"), tmp_path_factory.mktemp("data")
    port, own = free_port(), free_port()
    public = f"https://127.0.0.1:{port}"
    (at / "config.yaml").write_text(
        json.dumps({"public_hosts": [public], "trusted_proxies": ["127.0.0.1"], "access": "required"})
    )
    words = [sys.executable, "-P", "-m", "server.commands.command_line", "serve", "--port", str(own)]
    words += ["--data-dir", str(data), "--base-path", "/hilfit", "--config", str(at / "config.yaml")]
    made = certificate(Settings(data_dir=at, tls="self-signed"), DataDirectory(at), lambda: datetime.now(UTC))
    location = re.search(r"^location /hilfit/ \{.*?^\}", (ROOT / "docs/access.md").read_text(), re.M | re.S)
    assert made is not None and location is not None
    lines = location.group().replace("127.0.0.1:8350", f"127.0.0.1:{own}")
    (at / "nginx.conf").write_text(FRAME.format(at=at, port=port, crt=made.path, key=made.key, location=lines))
    with (
        subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as service,
        subprocess.Popen([str(NGINX), "-p", str(at), "-c", str(at / "nginx.conf")]) as proxy,
    ):
        assert service.stderr is not None
        said = next(line for line in service.stderr if "pair the first admin" in line)
        drain = threading.Thread(target=service.stderr.read)
        drain.start()
        context = ssl.create_default_context(cafile=str(made.path))
        try:
            with httpx2.Client(verify=context, timeout=LONG_S, headers={"Origin": public}) as client:
                yield f"{public}/hilfit", said, client
        finally:
            for process in (proxy, service):
                process.terminate()
                process.wait(60)
            drain.join()


def test_a_site_behind_nginx_is_paired_written_to_read_and_streamed(
    site: tuple[str, str, httpx2.Client], tmp_path: Path
) -> None:
    url, said, client = site
    found = re.search(r"(https://\S+)/#pair=(\d+)", said)
    assert found is not None and found.group(1) == url, said  # what is printed is what a tablet can open
    assert client.get(f"{found.group(1)}/").status_code == 200
    body = {"code": found.group(2), "name": "tablet"}
    paired = client.post(f"{url}{API}/access/pair", json=body)
    assert paired.status_code == 201, paired.text
    client.headers["Authorization"] = f"Bearer {paired.json()['token']}"
    made = client.post(f"{url}{API}/machines", content=named("lever"))
    assert (made.status_code, made.headers["location"]) == (201, f"/hilfit{API}/machines/lever"), made.text
    upload = client.post(
        f"{url}{API}/recordings/upload",
        params={"machine": "lever", "role": "operation", "name": "run.csv"},
        content=recording_bytes(tmp_path, "operation", ".csv"),
    )
    assert upload.status_code == 201, upload.text
    code = client.post(f"{url}{API}/access/pairing-codes", json={"role": "viewer"}).json()
    assert code["url"].startswith(f"{url}/#pair=")
    with client.stream("GET", f"{url}{API}/events") as events:
        first = next(line for line in events.iter_lines() if line.startswith("data: "))
    assert "revision" in json.loads(first.removeprefix("data: "))


def test_a_page_from_elsewhere_is_refused_behind_nginx_as_well(site: tuple[str, str, httpx2.Client]) -> None:
    url, _, client = site
    for origin in ("https://evil.example", url.replace("https:", "http:").removesuffix("/hilfit")):
        refused = client.post(f"{url}{API}/machines", content=named("other"), headers={"Origin": origin})
        assert refused.status_code == 403, origin
