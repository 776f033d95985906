"""config/site.yaml with every example in it taken for meant, as a site does by hand: the "# " goes, and the line above of that key."""
import re

EXAMPLE = re.compile(r'^( *)# ( *(?:[a-z_]+:|- ).*)$')
KEY = re.compile(r'^( *[a-z_]+):')


def with_examples(text):
    """The text of the file with its examples; they are the lines of comment that hold a key or an item of a list."""
    lines = []
    for line in text.splitlines():
        example = EXAMPLE.match(line)
        if example:
            line = example.group(1) + example.group(2)
            key = KEY.match(line)
            if key and lines and lines[-1].startswith(key.group(1) + ':'):
                lines.pop()
        lines.append(line)
    return '\n'.join(lines) + '\n'
