"""A page of a real browser without a network, for tests of what people see."""

from pathlib import Path

PHONE = {"viewport": {"width": 390, "height": 844}, "is_mobile": True, "has_touch": True}


class Tab:
    """A page that notes down what should not happen: messages, dialogs, requests."""

    def __init__(self, page):
        self.page = page
        self.complaints = []
        page.on("console", self._message)
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("dialog", lambda dialog: (self.complaints.append(dialog.message), dialog.accept()))
        page.on("request", self._request)

    def _message(self, message):
        # Drawing by software, which screenshots hold up, is no fault of the page.
        if "GL Driver Message" not in message.text:
            self.complaints.append(message.text)

    def _request(self, request):
        if not request.url.startswith(("file:", "data:", "blob:")):
            self.complaints.append(request.url)

    def open(self, path):
        """Open a report, and wait until all its figures are there."""
        self.page.goto(Path(path).as_uri(), timeout=120_000)  # other tests may be at work, too
        self.page.wait_for_function(
            "[...document.querySelectorAll('.plotly-graph-div')].every(f => f.querySelector('svg'))"
        )

    def right_edge(self, selector):
        """Return how far to the right the elements reach, in pixels."""
        widest = "nodes => Math.max(...nodes.map(n => n.getBoundingClientRect().right))"
        return self.page.eval_on_selector_all(selector, widest)
