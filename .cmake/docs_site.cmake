# Target docs_site: the documents as a site with search in build/<preset>/site, where mkdocs-material is installed.
find_program(MKDOCS mkdocs)
if(NOT MKDOCS)
  return()
endif()
add_custom_target(docs_site COMMAND ${MKDOCS} build --quiet --strict --clean --config-file ${CMAKE_CURRENT_LIST_DIR}/docs_site.yml
                                    --site-dir ${PROJECT_BINARY_DIR}/site VERBATIM)
