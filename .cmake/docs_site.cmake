# Target docs_site: the documents as a site with search in build/<preset>/site, where mkdocs-material is installed.
find_program(MKDOCS mkdocs)
if(NOT MKDOCS)
  return()
endif()
if(TARGET esmc_python)  # the notebooks with what they print and draw
  set(results COMMAND /usr/bin/python3 ${CMAKE_CURRENT_LIST_DIR}/notebooks.py $<TARGET_FILE_DIR:esmc_python> ${PROJECT_BINARY_DIR}/notebooks
              COMMAND ${CMAKE_COMMAND} -E env ESMC_NOTEBOOKS=${PROJECT_BINARY_DIR}/notebooks)
else()
  set(results COMMAND)
endif()
add_custom_target(docs_site ${results} ${MKDOCS} build --quiet --strict --clean --config-file ${CMAKE_CURRENT_LIST_DIR}/docs_site.yml
                                    --site-dir ${PROJECT_BINARY_DIR}/site VERBATIM)
if(TARGET esmc_python)
  add_dependencies(docs_site esmc_python esmc)
endif()
