# What a Debian package holds besides the installed files; run by CPack in the staging folder.
set(root ${CPACK_TEMPORARY_INSTALL_DIRECTORY}${CPACK_PACKAGING_INSTALL_PREFIX})
set(doc ${root}/share/doc/${CPACK_PACKAGE_NAME})
if(DEFINED ENV{SOURCE_DATE_EPOCH})
  set(date --date=@$ENV{SOURCE_DATE_EPOCH})
endif()
execute_process(COMMAND date -R ${date} OUTPUT_VARIABLE now OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)

set(uplot ${CMAKE_CURRENT_LIST_DIR}/../host_sim/report/node_modules/uplot/LICENSE)  # in the command, for its reports
set(inlined "")
if(EXISTS ${uplot})
  file(READ ${uplot} licence)
  string(STRIP "${licence}" licence)
  string(REGEX MATCH "Copyright \\(c\\) ([^\n]*)" holder "${licence}")
  set(holder "${CMAKE_MATCH_1}")
  string(REGEX REPLACE "\n[ \t]*" "\n " licence "${licence}")
  string(REGEX REPLACE "\n \n" "\n .\n" licence "${licence}")
  set(inlined "
Files: host_sim/report/node_modules/uplot/*
Copyright: ${holder}
License: Expat
 ${licence}
")
endif()
file(WRITE ${doc}/copyright
"Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: esmc

Files: *
Copyright: 2026 the esmc authors
License: Apache-2.0
${inlined}
License: Apache-2.0
 On Debian systems the text of this licence is in
 /usr/share/common-licenses/Apache-2.0.
")
file(WRITE ${doc}/changelog
"esmc (${CPACK_PACKAGE_VERSION}) unstable; urgency=medium

  * See CHANGELOG.md of the source.

 -- ${CPACK_DEBIAN_PACKAGE_MAINTAINER}  ${now}
")
execute_process(COMMAND gzip -9nf ${doc}/changelog ${root}/share/man/man1/esmc.1 COMMAND_ERROR_IS_FATAL ANY)
file(GLOB archives ${root}/lib/*.a ${root}/lib/*/*.a)
execute_process(COMMAND strip --strip-debug --enable-deterministic-archives ${archives} COMMAND_ERROR_IS_FATAL ANY)
file(GLOB_RECURSE files ${root}/include/* ${root}/share/* ${root}/lib/*)
file(CHMOD ${files} PERMISSIONS OWNER_READ OWNER_WRITE GROUP_READ WORLD_READ)
