from . import program_edits as program_edits
from .chat import OfflineChatModel as OfflineChatModel
from .prompt_text import parse_prompt as parse_prompt
from .report_evidence import parse_report_evidence as parse_report_evidence
