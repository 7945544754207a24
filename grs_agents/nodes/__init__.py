"""The nodes of every graph: state in, update out."""

from grs_agents.nodes.comprehension import hide_image as hide_image
from grs_agents.nodes.graph_segments import RunGraph as RunGraph
from grs_agents.nodes.graph_segments import add_authors as add_authors
from grs_agents.nodes.graph_segments import add_competing_authors as add_competing_authors
from grs_agents.nodes.graph_segments import add_fix_loop as add_fix_loop
from grs_agents.nodes.graph_segments import add_judging as add_judging
from grs_agents.nodes.graph_segments import add_perception as add_perception
from grs_agents.nodes.graph_segments import add_tool_author as add_tool_author
from grs_agents.nodes.graph_segments import empty_graph as empty_graph
