from . import program_edits as program_edits
from .chat import OfflineChatModel as OfflineChatModel
from .prompt_text import read_prompt as read_prompt
from .report_evidence import read_evidence as read_evidence
