from .langgraph_server import build_served_graph as build_served_graph
from .langgraph_server import grs as grs
from .langgraph_server import llm_only as llm_only
from .langgraph_server import no_fix as no_fix
from .langgraph_server import no_router as no_router
from .langgraph_server import router as router
from .langgraph_server import scene as scene
from .mcp_server import serve_mcp as serve_mcp
