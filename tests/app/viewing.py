"""A viewer that is served in a thread, and a client that has its token."""

import json
import threading
import time
from contextlib import contextmanager
from http.client import HTTPConnection

from windmark.app import view_verb
from windmark.app.viewer.page import page
from windmark.app.viewer.session import Session


class Client:
    """Requests as the page makes them."""

    def __init__(self, server, session):
        self.server, self.session = server, session

    def raw(self, method, path, body=None, headers=None, host=None):
        """Status, content, headers; ``headers`` replace the page's own."""
        link = HTTPConnection("127.0.0.1", self.server.server_port, timeout=120)
        own = {"X-Windmark-Token": self.server.token, "Content-Type": "application/json"}
        own = {k: v for k, v in {**own, **(headers or {})}.items() if v is not None}
        try:
            link.putrequest(method, path, skip_host=True)
            link.putheader("Host", host or f"127.0.0.1:{self.server.server_port}")
            content = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
            if content is not None and "Content-Length" not in own:
                own["Content-Length"] = str(len(content))
            for name, value in own.items():
                link.putheader(name, value)
            link.endheaders(content)
            answer = link.getresponse()
            return answer.status, answer.read(), dict(answer.getheaders())
        finally:
            link.close()

    def ask(self, path, **said):
        """A request about the run that is shown: status and JSON."""
        run = self.session.shown.number if self.session.shown else 0
        status, content, _ = self.raw("POST", path, {"run": run, **said})
        return status, json.loads(content)

    def state(self):
        return json.loads(self.raw("GET", "/state")[1])

    def wait(self):
        """Until no job is at work."""
        while (state := self.state())["busy"]:
            time.sleep(0.05)
        return state


@contextmanager
def viewing(project, *, run=True):
    """A viewer of a project; ``run``: with its first run done."""
    session = Session(project.resolve(), page)
    server = view_verb.opened(session, "a test")
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    client = Client(server, session)
    try:
        if run:
            session.start(write=False)
            client.wait()
        yield client
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
        session.end()
