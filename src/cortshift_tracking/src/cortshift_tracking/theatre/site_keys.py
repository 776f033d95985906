"""What a person wrote in the file of a site, refused by its key where it is of another kind than the nodes take."""


class KeyFault(ValueError):
    """What stands under a key of the site's file is not of its kind."""


KINDS = {dict: 'a dictionary', list: 'a list', str: 'text'}


def given(values, key, kind, where, example):
    """What a person wrote under a key; an empty one where it is absent or left empty. KeyFault where it is of another kind."""
    value = values.get(key)
    if value is None:
        return kind()
    if not isinstance(value, kind):
        raise KeyFault(f'{where}{key} is {value!r:.60}, not {KINDS[kind]}; write {example}')
    return value


def given_texts(values, key, where, example):
    """A list of texts, as above."""
    texts = given(values, key, list, where, example)
    for text in texts:
        if not isinstance(text, str):
            raise KeyFault(f'{where}{key} holds {text!r:.60}, not text; write {example}')
    return texts


def section(site, name):
    """Parameters of one node in the site's file, as a dict."""
    return given(site, name, dict, '', f'"{name}:" and its parameters below, indented')
