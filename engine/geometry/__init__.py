"""Signed distances, frames and crossings; knows no physics."""
