"""A page of HTML taken apart, for tests of what people read."""

from html.parser import HTMLParser

VOID = ("meta", "br", "input")


class Page(HTMLParser):
    """A page's elements, the text that people read, and its tables as lists of rows."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.stack, self.texts, self.tables = [], [], [], []
        self.feed(html)
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))
        if tag not in VOID:
            self.stack.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag  # everything is closed in its order

    def handle_data(self, data):
        tag = self.stack[-1] if self.stack else None
        if tag in (None, "script", "style"):
            return
        self.texts.append(data)
        if tag in ("td", "th"):
            self.tables[-1][-1][-1] += data

    def count(self, tag):
        return sum(name == tag for name, _ in self.elements)

    def ids(self):
        return [attributes["id"] for _, attributes in self.elements if "id" in attributes]
