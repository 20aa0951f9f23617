"""A page of HTML taken apart, for tests of what people read."""

from lxml import html


class Page:
    """A page's elements, the text that people read, and its tables as lists of rows."""

    def __init__(self, text):
        tree = html.fromstring(text)
        self.elements = [(each.tag, dict(each.attrib)) for each in tree.iter(html.etree.Element)]
        for unread in tree.xpath("//script | //style"):
            unread.drop_tree()
        self.text = " ".join(" ".join(tree.itertext()).split())
        self.tables = [
            [[cell.text_content() for cell in row.iter("td", "th")] for row in table.iter("tr")]
            for table in tree.iter("table")
        ]

    def count(self, tag):
        return sum(name == tag for name, _ in self.elements)

    def ids(self):
        return [attributes["id"] for _, attributes in self.elements if "id" in attributes]
