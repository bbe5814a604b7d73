"""A page as a parser sees it: elements, what they would load, numbers, text."""

import re
from html.parser import HTMLParser

LOADING = ("src", "href", "srcset", "action", "data", "poster", "formaction", "xlink:href", "background")
VOID = {"meta", "link", "img", "br", "input", "hr"}


class Page(HTMLParser):
    """Collect elements, attributes, texts by the element they stand in, and values of data elements by section."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.elements, self.loads, self.styles, self.values = [], [], [], {}
        self.texts, self.path, self.section = [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        self.loads += [value for name, value in attrs if name in LOADING and value]
        self.styles += [value for name, value in attrs if name == "style" and value]
        if tag == "section":
            self.section = dict(attrs).get("id", "")
        if tag == "data":
            self.values.setdefault(self.section, []).append(float(dict(attrs)["value"]))
        if tag not in VOID:
            self.path.append(tag)

    def handle_endtag(self, tag):
        while self.path and self.path.pop() != tag:
            pass

    def handle_data(self, data):
        if "style" in self.path:
            self.styles.append(data)
        elif "script" not in self.path:
            self.texts.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.texts).split())

    def outside(self):
        """Return everything that would be fetched from elsewhere."""
        results = [url for url in self.loads if not url.startswith(("#", "data:"))]
        for style in self.styles:
            results += re.findall(r"@import[^;]*", style)
            results += [
                url for url in re.findall(r"url\(([^)]*)\)", style) if not url.strip("'\"").startswith(("#", "data:"))
            ]
        return results

    def count(self, tag):
        return sum(1 for name, _ in self.elements if name == tag)
