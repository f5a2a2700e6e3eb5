"""The cockpit: a page in the browser that shows a plan and drives the tip, and its server."""
