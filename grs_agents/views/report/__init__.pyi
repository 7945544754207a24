from . import pictures as pictures
from .html import POLICY as POLICY
from .html import escape_html as escape_html
from .page import render_html_report as render_html_report
from .pictures import Sources as Sources
