"""Motions driven in MuJoCo: contact forces of a plan, of a pushed scope, and an environment.

Needs the extra ``physics``.
"""
