"""The desktop application: document, views, panels, and jobs. A thin layer over nvsim, which never imports it."""

from nvsim_app.singleton_refcounts import protect_singletons

protect_singletons()
