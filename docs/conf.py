# SPDX-License-Identifier: Apache-2.0
"""Settings of Sphinx; `./run docs` builds the site, and so does rosdoc2 (rosdoc2.yaml)."""

from importlib.util import find_spec
from pathlib import Path
import re
import sys

HERE = Path(__file__).resolve().parent
# rosdoc2 copies this folder, and has a conf.py there that opens this one
_copied = re.search(r'open\("(.+)/docs/conf\.py"\)', Path(__file__).read_text('utf-8'))
sys.path[:0] = [str(HERE), _copied[1] if _copied else str(HERE.parent)]

from imu_bench import __version__  # noqa: E402
from reference import write_pages  # noqa: E402

project, author = 'imu_bench', 'imu_bench maintainers'
version = release = __version__
copyright = '2026, imu_bench maintainers. Apache-2.0'

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    # docstrings are of numpydoc; rosdoc2 brings Sphinx's own reader of them
    'numpydoc' if find_spec('numpydoc') else 'sphinx.ext.napoleon',
]
myst_heading_anchors = 3
numpydoc_show_class_members = False
autodoc_typehints = 'none'  # the docstrings say it with shapes and units
autodoc_member_order = 'bysource'
exclude_patterns = ['_build', 'man', 'images']
# what rosdoc2 puts beside the pages: every module, where the reference has what is stable, and
# copies of the README and others
exclude_patterns += ['modules.rst', 'imu_bench*.rst', 'standard_docs', 'standards.rst', '__*.rst']
smartquotes = False  # --options are no dashes
html_theme = 'sphinx_rtd_theme'
html_theme_options = {'navigation_depth': 2, 'collapse_navigation': False}
html_static_path = ['style']
html_css_files = ['tables.css']
html_show_sphinx = html_show_sourcelink = False


def setup(app):
    """Have the reference written before the pages are read; show diagrams as their text."""
    from pygments.lexers.special import TextLexer

    app.add_lexer('mermaid', TextLexer)
    app.connect('builder-inited', lambda app: write_pages())
