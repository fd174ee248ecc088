from .api import open_session, setup
from .edits import apply_tool, session_state
from .server import SetupServer
from .session import SetupSession

__all__ = ["SetupServer", "SetupSession", "apply_tool", "open_session", "session_state", "setup"]
