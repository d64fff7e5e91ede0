"""Pages that open in any browser from their file alone, without a network, a server or a library."""

from sfmcpp.study.pages.parts import packed, script, template

__all__ = ["packed", "script", "template"]
