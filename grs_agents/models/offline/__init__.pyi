from . import program_edits as program_edits
from .chat import OfflineChatModel as OfflineChatModel
from .chat import make_offline_model as make_offline_model
from .mistakes import MISTAKES as MISTAKES
from .mistakes import Mistake as Mistake
from .prompt_text import parse_prompt as parse_prompt
from .report_evidence import parse_report_evidence as parse_report_evidence
