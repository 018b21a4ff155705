"""Dot boards: which spot of a picture is which dot, from nothing but the spots."""

from windmark.calibration.board.find import find_board, find_boards
from windmark.calibration.board.view import CAUSES, FREEDOMS, BoardNotFound, BoardView, board_marker_set

__all__ = ["CAUSES", "FREEDOMS", "BoardNotFound", "BoardView", "board_marker_set", "find_board", "find_boards"]
