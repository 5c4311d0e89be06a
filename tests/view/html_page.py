"""A page as its reader sees it."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """Sections, charts, pictures, links and words of a page; complains of tags that do not close."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.sections, self.charts, self.links, self.words = [], [], [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        if found.get("class") == "panels":
            self.charts.append(found["aria-label"])
        if tag not in ("meta", "img", "wbr", "br"):
            self.open.append(tag)
        if "id" in found:
            self.ids.append(found["id"])
        if tag == "section":
            self.sections.append(found["id"])
        self.links += [found[key] for key in ("href", "src") if found.get(key)]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)
