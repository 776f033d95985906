"""Sphinx configuration of script/docs: the Markdown files of the project, where they lie."""
project = 'cortshift'
extensions = ['myst_parser']
root_doc = 'doc/index'
include_patterns = ['README.md', 'CONTRIBUTING.md', 'BENCHMARK.md', 'CHANGELOG.md', 'bags/README.md', 'doc/*.md']
exclude_patterns = ['build*', 'devel', 'install', 'src', '.git', 'demo_output', 'benchmark_output']
source_suffix = {'.md': 'markdown'}
myst_heading_anchors = 3          # links to headings, as in README.md
html_theme = 'alabaster'          # Sphinx's own: nothing is fetched
html_show_sphinx = False
html_copy_source = False
# Blocks name languages that Pygments does not all know; a block that it cannot colour is shown as it is.
suppress_warnings = ['misc.highlighting_failure']
